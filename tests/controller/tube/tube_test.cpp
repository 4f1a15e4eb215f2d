#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/random.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "controller/tube/reach_tube.hpp"
#include "sim/plant/drive_errors.hpp"
#include "sim/plant/kinematic_vehicle.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

TubePlan straight(double v_mps, double for_s) {
  return {std::vector<Twist>(static_cast<std::size_t>(std::lround(for_s / 0.05)), {v_mps, 0.0}),
          0.05};
}

TEST(ReachTubeTest, OfAPerfectVehicleHasNoWidth) {
  EXPECT_NEAR(reach_tube(straight(1.5, 4.0), {}).back(), 0.0, 1e-12);
}

/// 1 % of the way, and what cutting the support into directions adds.
TEST(ReachTubeTest, OfAWrongRadiusOnAStraightIsThatShareOfTheWay) {
  const double bound = reach_tube(straight(1.5, 4.0), {.radius = 0.01}).back();
  EXPECT_GE(bound, 0.06);
  EXPECT_LT(bound, 0.06 * 1.01);
}

TEST(ReachTubeTest, OfAWrongHeadingOnAStraightIsItsAngleTimesTheWay) {
  const double bound = reach_tube(straight(1.5, 4.0), {.start_rad = 0.01}).back();
  EXPECT_GE(bound, 2.0 * 6.0 * std::sin(0.005));
  EXPECT_LT(bound, 0.06 * 1.02);
}

/// v ω t²/2, reached by turning to one side all the time.
TEST(ReachTubeTest, OfAYawDisturbanceOnAStraightGrowsWithTheSquareOfTime) {
  const TubeBounds bounds{.yaw_radps = 0.01};
  const double two = reach_tube(straight(1.5, 2.0), bounds).back();
  const double four = reach_tube(straight(1.5, 4.0), bounds).back();
  EXPECT_GE(two, 1.5 * 0.01 * 2.0);
  EXPECT_LT(two, 1.5 * 0.01 * 2.0 * 1.05);
  EXPECT_NEAR(four / two, 4.0, 0.1);
}

TEST(ReachTubeTest, AClockOnAStraightWithOneSpeedDoesNoHarm) {
  EXPECT_NEAR(reach_tube(straight(1.5, 4.0), {.lag_s = 0.1, .clock_s = 0.1}).back(), 0.0, 1e-12);
}

/// A history of one speed, then a silence in which the path slows down.
TEST(ReachTubeTest, OfLaggingWheelsOnAPathThatSlowsDownHasWhatTheyHaveNotFollowedYet) {
  constexpr double kLag_s = 0.3, kSlower_mps2 = 1.0, kStep_s = 0.05;
  TubePlan plan{.twists = {}, .step_s = kStep_s, .before = 100, .after = 1};
  for (int i = 0; i < 107; ++i) plan.twists.push_back({10.0 - kSlower_mps2 * kStep_s * i, 0.0});
  // Wheels that have followed a ramp are behind it by its slope times their lag.
  const double bound_m = reach_tube(plan, {.lag_s = kLag_s})[6];
  EXPECT_GE(bound_m, kSlower_mps2 * kLag_s * 6 * kStep_s);
  EXPECT_LT(bound_m, 1.5 * kSlower_mps2 * kLag_s * 6 * kStep_s);
}

/// Errors of a vehicle within the bounds, each as a share of its bound from −1 to 1.
struct Luck {
  enum Of : std::size_t { radius, track, lag, clock, start, side, heading, left, turn_left, phase };
  static constexpr std::size_t kConstant = 10;
  std::vector<double> share;  ///< kConstant, then speed and yaw rate in each step of the silence

  double operator[](std::size_t i) const { return share[i]; }
};

/// The kinematic plant with its drive's errors, in silences that begin along all of a path. The
/// drive's past is driven, by plans which sampled the path at other times than the tube's.
class Silences {
 public:
  explicit Silences(const Scenario& scenario)
      : scenario_(scenario), tube_(scenario_.get<TubeSettings>()) {
    const auto path = make_path(scenario_.get<PathSettings>());
    const auto& run = scenario_.get<RunSettings>();
    constexpr int kStarts = 60;
    for (int i = 0; i < kStarts; ++i) {
      const double from_s =
          run.settled_from_s + (run.duration_s - run.settled_from_s) * i / kStarts;
      const TubePlan plan = plan_along(scenario_, *path, from_s, tube_.silence_s);
      starts_.push_back(
          {path, from_s, plan, reach_tube(plan, tube_bounds(scenario_, plan)), planned(plan)});
    }
  }

  double widest_m() const {
    double widest_m = 0.0;
    for (const Start& start : starts_) widest_m = std::max(widest_m, start.tube_m.back());
    return widest_m;
  }

  struct Outcome {
    int trials = 0, left = 0;
    double tightness = 0.0;  ///< worst deviation / bound, at the end of the silence
  };

  Outcome random(int trials, std::uint64_t seed) const {
    RandomEngine random = random_stream(seed, "tube/random");
    Outcome outcome;
    while (outcome.trials < trials)
      drive(at_random(random), starts_[outcome.trials % starts_.size()], outcome);
    return outcome;
  }

  /// From random corners, one share after the other to whatever takes the vehicle farther.
  Outcome adversarial(int trials, std::uint64_t seed) const {
    RandomEngine random = random_stream(seed, "tube/adversary");
    Outcome outcome;
    for (std::size_t start = 0; outcome.trials < trials; start = (start + 7) % starts_.size()) {
      Luck luck = at_random(random);
      for (double& share : luck.share) share = std::copysign(1.0, share);
      double best = drive(luck, starts_[start], outcome);
      for (std::size_t at = 0; at < luck.share.size() && outcome.trials < trials; ++at) {
        const double was = luck.share[at];
        double kept = was;
        const bool turns = at == Luck::side || at == Luck::lag || at == Luck::phase;
        for (const double to :
             turns ? std::vector{-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0}
                   : std::vector{-was}) {
          luck.share[at] = to;
          const double worst = drive(luck, starts_[start], outcome);
          if (worst <= best) continue;
          best = worst;
          kept = to;
        }
        luck.share[at] = kept;
      }
    }
    return outcome;
  }

 private:
  struct Start {
    std::shared_ptr<const ReferencePath> path;
    double from_s;
    TubePlan plan;
    std::vector<double> tube_m;
    std::vector<Pose2> planned;
  };

  /// Half of the shares at their edges; signs of disturbances that stay for a while.
  Luck at_random(RandomEngine& random) const {
    const auto within = [&] {
      const double share = 2.0 * uniform_01(random) - 1.0;
      return uniform_01(random) < 0.5 ? std::copysign(1.0, share) : share;
    };
    Luck luck;
    for (std::size_t i = 0; i < Luck::kConstant; ++i) luck.share.push_back(within());
    const double same = uniform_01(random);
    for (std::size_t i = 0; i < 2 * starts_.front().plan.steps(); ++i) {
      const bool stays = i >= 2 && uniform_01(random) < same;
      luck.share.push_back(stays ? luck.share[luck.share.size() - 2] : within());
    }
    return luck;
  }

  static constexpr double kRounding_m = 1e-9;  // where the bound is 0: one speed, straight on

  /// Deviation / bound at the end.
  double drive(const Luck& luck, const Start& start, Outcome& outcome) const {
    const TubeBounds& b = tube_.bounds;
    VehicleSettings vehicle = scenario_.get<VehicleSettings>();
    vehicle.radius_error = b.radius * luck[Luck::radius];
    vehicle.track_error = b.track * luck[Luck::track];
    vehicle.actuator_lag_ms = 1e3 * b.lag_s * 0.5 * (1.0 + luck[Luck::lag]);
    vehicle.start_x_m = vehicle.start_y_m = vehicle.start_yaw_rad = 0.0;
    DriveErrors errors(vehicle);
    const Duration step = step_of(scenario_.get<WorldSettings>());
    KinematicVehicle agv(vehicle, scenario_.get<WorldSettings>(), step);
    const double dt_s = to_seconds(step), step_s = start.plan.step_s;
    const auto ticks = [&](double s) { return std::lround(s / dt_s); };
    const long in_step = ticks(step_s), clock = ticks(b.clock_s * luck[Luck::clock]);
    const long phase = ticks(0.5 * step_s * luck[Luck::phase]);
    Twist twist;
    long sampled = -1'000'000'000;
    // The wheels turn from rest to the path's speed within the last seconds before the silence.
    const long wheels_from = -ticks(3.0 + b.clock_s);
    const auto turn = [&](long now) {
      const long at = now + clock;
      const long shift = at < 0 ? phase : 0;
      const long slot = (at - shift >= 0 ? at - shift : at - shift - in_step + 1) / in_step;
      const long key = 2 * slot + (at < 0 ? 0 : 1);
      if (key != sampled) {
        const double t_s = static_cast<double>(slot * in_step + shift) * dt_s + 0.5 * step_s;
        const PathPoint p = start.path->at(std::max(0.0, start.from_s + t_s));
        twist = {p.v_mps, p.omega_radps};
        if (at < 0) {
          twist.v_mps += b.left_mps * luck[Luck::left];
          twist.omega_radps += b.left_radps * luck[Luck::turn_left];
        }
        sampled = key;
      }
      const WheelSpeeds rims = errors.step(twist, dt_s);
      if (now < wheels_from) return;
      agv.set_wheel_targets(rims);
      agv.step();
    };
    const double past_s = 24.0 * 1e-3 * vehicle.actuator_lag_ms + 4.0 + b.clock_s;
    for (long now = -ticks(past_s); now < 0; ++now) turn(now);
    const double side_rad = std::numbers::pi * luck[Luck::side];
    const double start_m = b.start_m * std::abs(luck[Luck::start]);
    Pose2 at{start_m * std::cos(side_rad), start_m * std::sin(side_rad),
             b.start_rad * luck[Luck::heading]};
    bool left = false;
    double ratio = 0.0;
    for (std::size_t k = 0; k < start.plan.steps(); ++k) {
      const std::size_t disturbed = Luck::kConstant + 2 * k;
      for (long i = 0; i < in_step; ++i) {
        turn(static_cast<long>(k) * in_step + i);
        const Twist is = agv.state().twist;
        // The disturbance is not the wheels': it adds to what they do.
        at = moved(at,
                   {is.v_mps + b.speed_mps * luck[disturbed],
                    is.omega_radps + b.yaw_radps * luck[disturbed + 1]},
                   dt_s);
      }
      const Pose2& to = start.planned[k + 1];
      ratio = std::hypot(at.x_m - to.x_m, at.y_m - to.y_m) / (start.tube_m[k + 1] + kRounding_m);
      left = left || ratio > 1.0;
    }
    ++outcome.trials;
    outcome.left += left ? 1 : 0;
    outcome.tightness = std::max(outcome.tightness, ratio);
    return ratio;
  }

  static Pose2 moved(const Pose2& p, const Twist& u, double dt_s) {
    const double middle = p.yaw_rad + 0.5 * u.omega_radps * dt_s;
    return {p.x_m + u.v_mps * dt_s * std::cos(middle), p.y_m + u.v_mps * dt_s * std::sin(middle),
            p.yaw_rad + u.omega_radps * dt_s};
  }

  Scenario scenario_;
  TubeSettings tube_;
  std::vector<Start> starts_;
};

/// A shipped scenario with a law that plans.
Scenario with_tube(const std::string& file, const std::vector<std::string>& bounds) {
  std::vector<std::string> set{"controller.law=predictive_consistent",
                               "controller.external=false",
                               "autonomy.enabled=false",
                               "actuator.policy=horizon",
                               "vehicle.plant=kinematic",
                               "vehicle.drivetrain=direct",
                               "vehicle.radius_error=0",
                               "vehicle.track_error=0",
                               "vehicle.actuator_lag_ms=0",
                               "vehicle.clock_offset_ms=0",
                               "world.half_extent_m=1000",
                               "controller.horizon_s=2",
                               "tube.silence_s=1"};
  set.insert(set.end(), bounds.begin(), bounds.end());
  return load_scenario(file, set);
}

/// TETHER_TUBE_RANDOM and TETHER_TUBE_ADVERSARIAL say how many trials there are on all scenarios
/// together; docs/explanation/margins.md has those of a whole campaign.
int trials(const char* variable, int otherwise) {
  const char* const many = std::getenv(variable);
  return many != nullptr ? std::atoi(many) : otherwise;
}

struct TubeTrials : testing::TestWithParam<std::string> {
  static std::vector<std::string> scenarios() {
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(in_source("/scenarios"))) {
      if (entry.path().extension() == ".toml") files.push_back(entry.path().filename().string());
    }
    std::ranges::sort(files);
    return files;
  }

  void no_vehicle_leaves_it(const std::string& what, const std::vector<std::string>& bounds,
                            double tight) const {
    const auto cases = static_cast<int>(2 * scenarios().size());
    const Silences silences(with_tube(in_source("/scenarios/" + GetParam()), bounds));
    const Silences::Outcome random = silences.random(trials("TETHER_TUBE_RANDOM", 2400) / cases, 1);
    const Silences::Outcome adversary =
        silences.adversarial(trials("TETHER_TUBE_ADVERSARIAL", 7200) / cases, 2);
    std::printf("%s, %s: random %d, %d left, worst / bound %.3f; adversarial %d, %d left, %.3f\n",
                GetParam().c_str(), what.c_str(), random.trials, random.left, random.tightness,
                adversary.trials, adversary.left, adversary.tightness);
    std::fflush(stdout);
    EXPECT_EQ(random.left, 0);
    EXPECT_EQ(adversary.left, 0);
    EXPECT_GT(adversary.tightness, silences.widest_m() > 1e-3 ? tight : 0.0);
  }
};

TEST_P(TubeTrials, NoVehicleWithLaggingWheelsLeavesIt) {
  no_vehicle_leaves_it("lag", {"tube.lag_s=0.3"}, 0.7);
}

TEST_P(TubeTrials, NoVehicleWithAllErrorsTogetherLeavesItAndTheWorstComesNearIt) {
  no_vehicle_leaves_it(
      "all",
      {"tube.radius=0.01", "tube.track=0.02", "tube.lag_s=0.05", "tube.clock_s=0.02",
       "tube.speed_mps=0.02", "tube.yaw_radps=0.01", "tube.start_m=0.02", "tube.start_rad=0.01",
       "tube.left_mps=0.05", "tube.left_radps=0.05"},
      0.5);
}

INSTANTIATE_TEST_SUITE_P(OfShippedScenarios, TubeTrials, testing::ValuesIn(TubeTrials::scenarios()),
                         [](const auto& of) { return of.param.substr(0, of.param.find('.')); });

TEST(LongestSilenceTest, KeepsTheBudgetAndAStepMoreDoesNot) {
  const Scenario scenario =
      load_scenario(in_source("/scenarios/paper.toml"),
                    {"controller.law=predictive", "actuator.policy=horizon", "tube.silence_s=1",
                     "tube.radius=0.01", "tube.track=0.01", "tube.start_m=0.02"});
  const LongestSilence longest = longest_silence(scenario, 0.1);
  ASSERT_GT(longest.silence_s, 0.0);
  EXPECT_FALSE(longest.or_longer);
  EXPECT_NEAR(longest.at_once_m, 0.02, 1e-9);
  const PathTube tube = path_tube(scenario, longest.silence_s + 1.0);
  EXPECT_LE(tube.after_m(longest.silence_s), 0.1);
  EXPECT_GT(tube.after_m(longest.silence_s + tube.step_s), 0.1);
}

TEST(LongestSilenceTest, IsNoneWhereTheStartIsBeyondTheBudgetAndEndsAt16Seconds) {
  const std::string file = in_source("/scenarios/paper.toml");
  const std::vector<std::string> plans{"controller.law=predictive", "actuator.policy=horizon",
                                       "tube.silence_s=1", "tube.start_m=0.02"};
  const LongestSilence none = longest_silence(load_scenario(file, plans), 0.01);
  EXPECT_EQ(none.silence_s, 0.0);
  EXPECT_NEAR(none.at_once_m, 0.02, 1e-9);
  const LongestSilence all = longest_silence(load_scenario(file, plans), 1000.0);
  EXPECT_TRUE(all.or_longer);
  EXPECT_NEAR(all.silence_s, 16.0, 1e-9);
}

TEST(LongestSilenceTest, EndsWithThePlan) {
  const LongestSilence plan =
      longest_silence(load_scenario(in_source("/scenarios/paper.toml"),
                                    {"controller.law=predictive", "actuator.policy=horizon",
                                     "controller.horizon_s=1", "tube.silence_s=1"}),
                      1000.0);
  EXPECT_TRUE(plan.or_longer);
  EXPECT_NEAR(plan.silence_s, 1.0, 1e-9);
}

TEST(PathTubeTest, IsRefusedWhereTheVehicleCannotBeWithinIt) {
  const auto refusal = [](const std::vector<std::string>& more) -> std::string {
    std::vector<std::string> set{"controller.law=predictive", "actuator.policy=horizon",
                                 "tube.silence_s=2"};
    set.insert(set.end(), more.begin(), more.end());
    try {
      tube_m(load_scenario(in_source("/scenarios/paper.toml"), set));
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal({}), "");
  EXPECT_NE(refusal({"controller.horizon_s=1.5"}).find("controller.horizon_s"), std::string::npos);
  EXPECT_NE(refusal({"vehicle.max_wheel_speed_mps=1.5"}).find("vehicle.max_wheel_speed_mps"),
            std::string::npos);
  EXPECT_NE(refusal({"world.slope_x=0.05"}).find("tube.speed_mps"), std::string::npos);
  EXPECT_EQ(refusal({"world.slope_x=0.05", "tube.speed_mps=0.1", "tube.yaw_radps=0.1"}), "");
}

TEST(LongestSilenceTest, IsRefusedWhereCommandsAreHeld) {
  EXPECT_THROW(longest_silence(load_scenario(in_source("/scenarios/paper.toml"), {}), 0.1),
               UsageError);
}

}  // namespace
}  // namespace tether
