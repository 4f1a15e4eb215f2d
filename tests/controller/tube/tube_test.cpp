#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/random.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "controller/tube/tube_settings.hpp"
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

/// Runs of the kinematic plant that drive a piece of the eight's plan, each with errors within the
/// bounds, half of them at their edges. TETHER_TUBE_RUNS says how many; the whole campaign has 10⁶.
class TubeRuns {
 public:
  TubeRuns()
      : scenario_(load_scenario(
            in_source("/scenarios/paper.toml"),
            {"controller.law=predictive_consistent", "actuator.policy=horizon",
             "vehicle.plant=kinematic", "tube.silence_s=1", "tube.radius=0.01", "tube.track=0.02",
             "tube.lag_s=0.05", "tube.clock_s=0.02", "tube.speed_mps=0.02", "tube.yaw_radps=0.01",
             "tube.start_m=0.02", "tube.start_rad=0.01"})) {
    const auto path = make_path(scenario_.get<PathSettings>());
    for (double from_s = 10.0; from_s < 62.0; from_s += 4.0) {
      Piece piece{plan_along(*path, from_s, 1.0, 0.05), {}, {}};
      piece.tube_m = reach_tube(piece.plan, tube_bounds(scenario_, piece.plan));
      piece.planned = planned(piece.plan);
      pieces_.push_back(piece);
    }
  }

  struct Outcome {
    int left = 0;
    double tightness = 0.0;  ///< worst deviation / bound, at the end of the silence
  };

  Outcome drive(int runs) const {
    Outcome outcome;
    for (int i = 0; i < runs; ++i) {
      drive_one(pieces_[static_cast<std::size_t>(i) % pieces_.size()],
                static_cast<std::uint64_t>(i), outcome);
    }
    return outcome;
  }

 private:
  struct Piece {
    TubePlan plan;
    std::vector<double> tube_m;
    std::vector<Pose2> planned;
  };

  void drive_one(const Piece& piece, std::uint64_t seed, Outcome& outcome) const {
    RandomEngine random = random_stream(seed, "tube");
    const TubeBounds& b = scenario_.get<TubeSettings>().bounds;
    const auto within = [&](double most) {
      const double luck = 2.0 * uniform_01(random) - 1.0;
      return uniform_01(random) < 0.5 ? std::copysign(most, luck) : luck * most;
    };
    VehicleSettings vehicle = scenario_.get<VehicleSettings>();
    vehicle.radius_error = within(b.radius);
    vehicle.track_error = within(b.track);
    vehicle.actuator_lag_ms = 1e3 * std::abs(within(b.lag_s));
    const double clock_s = within(b.clock_s), start_m = std::abs(within(b.start_m));
    const double side_rad = 2.0 * std::numbers::pi * uniform_01(random);
    vehicle.start_x_m = start_m * std::cos(side_rad);
    vehicle.start_y_m = start_m * std::sin(side_rad);
    vehicle.start_yaw_rad = within(b.start_rad);
    const double same = uniform_01(random);  // how often a disturbance keeps its sign
    DriveErrors errors(vehicle);
    const Duration step = step_of(scenario_.get<WorldSettings>());
    KinematicVehicle agv(vehicle, scenario_.get<WorldSettings>(), step);
    settle(agv, errors, piece.plan, clock_s, vehicle);
    double speed = within(b.speed_mps), yaw = within(b.yaw_radps);
    const Pose2 start{vehicle.start_x_m, vehicle.start_y_m, vehicle.start_yaw_rad};
    Pose2 at = start;
    const double dt_s = to_seconds(step);
    const int steps = static_cast<int>(std::lround(piece.plan.step_s / dt_s));
    for (std::size_t k = 0; k < piece.plan.twists.size(); ++k) {
      if (uniform_01(random) > same) speed = within(b.speed_mps);
      if (uniform_01(random) > same) yaw = within(b.yaw_radps);
      for (int i = 0; i < steps; ++i) {
        const double t_s = (static_cast<double>(k) * steps + i) * dt_s + clock_s;
        agv.set_wheel_targets(errors.step(twist_at(piece.plan, t_s), dt_s));
        agv.step();
        const Twist is = agv.state().twist;
        // The disturbance is not the wheels': it adds to what they do.
        at = moved(at, {is.v_mps + speed, is.omega_radps + yaw}, dt_s);
      }
      const Pose2& to = piece.planned[k + 1];
      const double off_m = std::hypot(at.x_m - to.x_m, at.y_m - to.y_m);
      if (off_m > piece.tube_m[k + 1]) ++outcome.left;
      if (k + 1 == piece.plan.twists.size()) {
        outcome.tightness = std::max(outcome.tightness, off_m / piece.tube_m[k + 1]);
      }
    }
  }

  static Pose2 moved(const Pose2& p, const Twist& u, double dt_s) {
    const double middle = p.yaw_rad + 0.5 * u.omega_radps * dt_s;
    return {p.x_m + u.v_mps * dt_s * std::cos(middle), p.y_m + u.v_mps * dt_s * std::sin(middle),
            p.yaw_rad + u.omega_radps * dt_s};
  }

  static Twist twist_at(const TubePlan& plan, double t_s) {
    const auto last = static_cast<double>(plan.twists.size()) - 1.0;
    return plan
        .twists[static_cast<std::size_t>(std::clamp(std::floor(t_s / plan.step_s), 0.0, last))];
  }

  /// The wheels are at the plan's first twist, and a clock that is ahead has gone on from there.
  static void settle(KinematicVehicle& agv, DriveErrors& errors, const TubePlan& plan,
                     double clock_s, const VehicleSettings& vehicle) {
    const double long_s = 20.0 * 1e-3 * vehicle.actuator_lag_ms + 2.0;
    const int steps = static_cast<int>(long_s / 1e-3);
    for (int i = 0; i < steps; ++i) {
      const double t_s = (i - steps) * 1e-3 + clock_s;
      agv.set_wheel_targets(errors.step(twist_at(plan, std::max(t_s, 0.0)), 1e-3));
      agv.step();
    }
  }

  Scenario scenario_;
  std::vector<Piece> pieces_;
};

TEST(TubeRunsTest, NoRunWithinTheBoundsLeavesTheTubeAndTheWorstComesNearIt) {
  const char* const many = std::getenv("TETHER_TUBE_RUNS");
  const int runs = many != nullptr ? std::atoi(many) : 2000;
  const TubeRuns::Outcome outcome = TubeRuns().drive(runs);
  std::printf("%d runs, %d left the tube; worst / bound = %.3f\n", runs, outcome.left,
              outcome.tightness);
  EXPECT_EQ(outcome.left, 0);
  EXPECT_GT(outcome.tightness, 0.6);
  EXPECT_LE(outcome.tightness, 1.0);
}

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
