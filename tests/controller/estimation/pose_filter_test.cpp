#include "controller/laws/pose_filter.hpp"

#include <gtest/gtest.h>

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/random/normal_distribution.hpp>
#include <boost/random/uniform_01.hpp>
#include <cmath>
#include <functional>
#include <vector>

#include "common/base/random.hpp"
#include "tests/controller/estimation/pose_nees.hpp"

namespace tether {
namespace {

constexpr Adaptation kNothing{};
constexpr Adaptation kAll{.radius = true, .track = true, .lag = true, .bias = true};
constexpr double kStep_s = 0.05;

/// Approximate command of a figure eight.
Twist command_at(double t_s) {
  return {2.0 + 0.8 * std::cos(0.2 * t_s), 0.35 * std::sin(0.1 * t_s)};
}

/// The interval that contains the mean of `n` χ² values of 3 degrees of freedom in 95 % of cases
/// (Bar-Shalom et al., section 5.4.2).
struct Bounds {
  double low, high;
  explicit Bounds(int n) : low(quantile(n, 0.025)), high(quantile(n, 0.975)) {}
  static double quantile(int n, double p) {
    return boost::math::quantile(boost::math::chi_squared(3.0 * n), p) / n;
  }
};

/// A vehicle that drifts as the filter takes it to, its noisy poses, and the filter.
struct FilterRig {
  PoseFilterSettings settings{.position_noise_m = 0.05, .yaw_noise_rad = 0.0349};
  MotionModel truth_model{{}};
  MotionModel::State truth;
  PoseFilter filter;
  RandomEngine random;
  boost::random::normal_distribution<double> normal;
  double t_s = 0.0;

  explicit FilterRig(std::uint64_t seed, const Adaptation& adapt = kNothing,
                     const DriveModel& drive = {})
      : truth_model({}, drive),
        filter(settings, adapt, {}, {}),
        random(random_stream(seed, "filter rig")) {
    truth.pose = {settings.start_m * draw(), settings.start_m * draw(),
                  settings.start_rad * draw()};
  }
  double draw() { return normal(random); }
  void drive(double seconds) {
    const double root_s = std::sqrt(0.01);
    for (double end_s = t_s + seconds; t_s < end_s - 1e-9; t_s += kStep_s) {
      filter.advance(command_at(t_s), kStep_s);
      for (int i = 0; i < 5; ++i) {
        truth_model.advance(truth, command_at(t_s), 0.01);
        truth.pose.x_m += settings.position_drift_mpsqrts * root_s * draw();
        truth.pose.y_m += settings.position_drift_mpsqrts * root_s * draw();
        truth.pose.yaw_rad += settings.yaw_drift_radpsqrts * root_s * draw();
      }
    }
  }
  Pose2 measured() {
    return {truth.pose.x_m + settings.position_noise_m * draw(),
            truth.pose.y_m + settings.position_noise_m * draw(),
            wrap_angle(truth.pose.yaw_rad + settings.yaw_noise_rad * draw())};
  }
  double nees() const { return pose_nees(filter, truth.pose); }
  double error_m() const {
    return std::hypot(truth.pose.x_m - filter.state().pose.x_m,
                      truth.pose.y_m - filter.state().pose.y_m);
  }
};

TEST(PoseFilter, ItsJacobianIsThatOfTheModel) {
  const DriveModel drives[] = {{}, {1.02, 0.98, 0.1, 0.05, -0.02}, {0.97, 1.03, 0.0, 0.0, 0.0}};
  for (const DriveModel& drive : drives) {
    for (const double from_mps : {1.9, 0.5}) {  // near the command, and far below it
      const Twist command{2.0, 0.3};
      const auto after = [&](PoseFilter::Vector v) {
        const MotionModel model({}, {v[7], v[8], v[9], v[10], v[11]});
        MotionModel::State s{{v[0], v[1], v[2]}, {v[3], v[4]}, {v[5], v[6]}};
        model.advance(s, command, 0.01);
        const DriveModel& d = model.drive();
        return PoseFilter::Vector{s.pose.x_m,          s.pose.y_m,
                                  s.pose.yaw_rad,      s.rim.left_mps,
                                  s.rim.right_mps,     s.lagging.left_mps,
                                  s.lagging.right_mps, d.rim_scale,
                                  d.turn_scale,        d.lag_s,
                                  d.v_bias_mps,        d.omega_bias_radps};
      };
      const PoseFilter::Vector v{1.0,
                                 2.0,
                                 0.7,
                                 from_mps,
                                 from_mps,
                                 from_mps,
                                 from_mps + 0.01,
                                 drive.rim_scale,
                                 drive.turn_scale,
                                 drive.lag_s,
                                 drive.v_bias_mps,
                                 drive.omega_bias_radps};
      const MotionModel model({}, drive);
      const MotionModel::State before{{v[0], v[1], v[2]}, {v[3], v[4]}, {v[5], v[6]}};
      MotionModel::State moved = before;
      model.advance(moved, command, 0.01);
      const auto jacobian = PoseFilter::jacobian(model, before, moved, command, 0.01);
      for (std::size_t j = 0; j < v.size(); ++j) {
        if (drive.lag_s == 0.0 && j >= 3 && j <= 9) continue;  // the ramp ends within the step
        PoseFilter::Vector more = v, less = v;
        more[j] += 1e-6;
        less[j] -= 1e-6;
        const auto up = after(more), down = after(less);
        for (std::size_t i = 0; i < v.size(); ++i) {
          EXPECT_NEAR(jacobian[i * v.size() + j], (up[i] - down[i]) / 2e-6, 2e-5)
              << i << " by " << j << ", lag " << drive.lag_s << ", from " << from_mps;
        }
      }
    }
  }
}

/// A lag begins at 0, where the model's own derivative is that of a step to the right.
TEST(PoseFilter, ItsJacobianSeesALagFromNoneOn) {
  const Twist command{2.01, 0.0};
  const MotionModel none({}), some({}, {.lag_s = 1e-5});
  MotionModel::State a{{}, {2.0, 2.0}, {2.0, 2.0}}, b = a;
  const MotionModel::State before = a;
  none.advance(a, command, 0.01);
  some.advance(b, command, 0.01);
  const auto jacobian = PoseFilter::jacobian(none, before, a, command, 0.01);
  EXPECT_NEAR(jacobian[5 * PoseFilter::kStates + 9],
              (b.lagging.left_mps - a.lagging.left_mps) / 1e-5, 0.05);
  EXPECT_LT(jacobian[0 * PoseFilter::kStates + 9], 0.0);
}

TEST(PoseFilter, ItsErrorsAreAsLargeAsItSays) {
  // 95 % bounds of means of 50 runs each. At 12 times of a run, of which 2 may lie outside: with
  // independent runs more do so in 2 of 100 sets of seeds.
  constexpr int kRuns = 50, kTimes = 12;
  std::vector<double> nis(kTimes), nees(kTimes);
  for (int run = 0; run < kRuns; ++run) {
    FilterRig rig(static_cast<std::uint64_t>(run + 1));
    boost::random::uniform_01<double> uniform;
    for (std::size_t k = 0; k < kTimes; ++k) {
      for (int lost = 0; lost < 4; ++lost) {  // a PRR of 0.45, once a second
        rig.drive(1.0);
        if (uniform(rig.random) < 0.45) rig.filter.update(rig.measured());
      }
      rig.drive(1.0);
      rig.filter.update(rig.measured());
      nis[k] += rig.filter.last_nis() / kRuns;
      nees[k] += rig.nees() / kRuns;
    }
  }
  const Bounds bounds(kRuns);
  int outside_nis = 0, outside_nees = 0;
  for (std::size_t k = 0; k < kTimes; ++k) {
    outside_nis += nis[k] < bounds.low || nis[k] > bounds.high;
    outside_nees += nees[k] < bounds.low || nees[k] > bounds.high;
  }
  EXPECT_LE(outside_nis, 2);
  EXPECT_LE(outside_nees, 2);
}

TEST(PoseFilter, AFilterThatTakesThePosesForBetterThanTheyAreIsFoundOut) {
  constexpr int kRuns = 50;
  double nis = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    FilterRig rig(static_cast<std::uint64_t>(run + 1));
    rig.settings.position_noise_m = 0.075;
    rig.settings.yaw_noise_rad = 0.052;
    rig.drive(10.0);
    rig.filter.update(rig.measured());
    nis += rig.filter.last_nis() / kRuns;
  }
  EXPECT_GT(nis, Bounds(kRuns).high);
}

TEST(PoseFilter, IsBetterThanThePoses) {
  double filtered = 0.0, raw = 0.0;
  FilterRig rig(7);
  for (int i = 0; i < 60; ++i) {
    rig.drive(1.0);
    const Pose2 z = rig.measured();
    rig.filter.update(z);
    filtered += rig.error_m();
    raw += std::hypot(z.x_m - rig.truth.pose.x_m, z.y_m - rig.truth.pose.y_m);
  }
  EXPECT_LT(filtered, 0.5 * raw);
}

TEST(PoseFilter, WithoutPosesItSaysThatItKnowsLess) {
  FilterRig rig(1);
  rig.drive(1.0);
  const double soon_m = rig.filter.standard_deviation(1);
  rig.drive(20.0);
  EXPECT_GT(rig.filter.standard_deviation(1), 2.0 * soon_m);
}

TEST(PoseFilter, StandingStillItLosesNothing) {
  FilterRig rig(1);
  const double before_m = rig.filter.standard_deviation(0);
  rig.filter.advance({}, 100.0);
  EXPECT_EQ(rig.filter.standard_deviation(0), before_m);
  EXPECT_TRUE(rig.filter.stands());
}

TEST(PoseFilter, GatesAPoseThatCannotBeAndGoesOn) {
  FilterRig rig(3);
  for (int i = 0; i < 10; ++i) {
    rig.drive(1.0);
    rig.filter.update(rig.measured());
  }
  rig.drive(1.0);
  const MotionModel::State before = rig.filter.state();
  Pose2 wrong = rig.measured();
  wrong.x_m += 3.0;
  EXPECT_EQ(rig.filter.update(wrong), PoseFilter::Verdict::gated);
  EXPECT_EQ(rig.filter.state().pose.x_m, before.pose.x_m);
  EXPECT_EQ(rig.filter.gated(), 1);
  EXPECT_EQ(rig.filter.update(rig.measured()), PoseFilter::Verdict::accepted);
}

TEST(PoseFilter, FollowsAJumpThatPersists) {
  FilterRig rig(4);
  rig.drive(5.0);
  rig.filter.update(rig.measured());
  rig.truth.pose.x_m += 2.0;
  const PoseFilter::Verdict expected[] = {PoseFilter::Verdict::gated, PoseFilter::Verdict::gated,
                                          PoseFilter::Verdict::reset,
                                          PoseFilter::Verdict::accepted};
  for (const PoseFilter::Verdict verdict : expected) {
    rig.drive(1.0);
    EXPECT_EQ(rig.filter.update(rig.measured()), verdict);
  }
  EXPECT_LT(rig.error_m(), 0.3);
  EXPECT_EQ(rig.filter.resets(), 1);
}

TEST(PoseFilter, PosesThatAreEachWrongInAnotherWayDoNotResetItSoon) {
  FilterRig rig(5);
  rig.drive(5.0);
  rig.filter.update(rig.measured());
  for (int i = 1; i < PoseFilter::kMostGated; ++i) {
    rig.drive(1.0);
    Pose2 wrong = rig.measured();
    wrong.y_m += (i % 2 == 0 ? 3.0 : -3.0) * i;
    EXPECT_EQ(rig.filter.update(wrong), PoseFilter::Verdict::gated) << i;
  }
  rig.drive(1.0);
  EXPECT_EQ(rig.filter.update(rig.measured()), PoseFilter::Verdict::accepted);
  EXPECT_LT(rig.error_m(), 0.3);
}

TEST(PoseFilter, AVehicleThatIsHeldFastResetsItInTheEnd) {
  FilterRig rig(6);
  rig.drive(5.0);
  rig.filter.update(rig.measured());
  const Pose2 wall = rig.measured();
  int poses = 0;
  while (rig.filter.resets() == 0 && poses < 20) {
    rig.drive(1.0);
    rig.filter.update(wall);
    ++poses;
  }
  EXPECT_LE(poses, PoseFilter::kMostGated);
  EXPECT_EQ(rig.filter.state().pose.x_m, wall.x_m);
}

TEST(PoseFilter, WithoutAdaptationItsModelStaysAsGiven) {
  FilterRig rig(8, kNothing, {.rim_scale = 1.03});
  for (int i = 0; i < 30; ++i) {
    rig.drive(1.0);
    rig.filter.update(rig.measured());
  }
  EXPECT_TRUE(rig.filter.model().drive() == DriveModel{});
}

TEST(PoseFilter, EstimatesStayWithinTheirBounds) {
  FilterRig rig(9, kAll, {.rim_scale = 1.4, .turn_scale = 0.5, .lag_s = 1.0});
  for (int i = 0; i < 60; ++i) {
    rig.drive(1.0);
    rig.filter.update(rig.measured());
    const DriveModel& d = rig.filter.model().drive();
    ASSERT_LE(std::abs(d.rim_scale - 1.0), PoseFilter::kMostScale + 1e-12);
    ASSERT_LE(std::abs(d.turn_scale - 1.0), PoseFilter::kMostScale + 1e-12);
    ASSERT_GE(d.lag_s, 0.0);
    ASSERT_LE(d.lag_s, PoseFilter::kMostLag_s);
    ASSERT_LE(std::abs(d.v_bias_mps), PoseFilter::kMostBias_mps);
    ASSERT_LE(std::abs(d.omega_bias_radps), PoseFilter::kMostBias_radps);
  }
}

}  // namespace
}  // namespace tether
