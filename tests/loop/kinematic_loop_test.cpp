#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/run_observer.hpp"

// The whole loop with the kinematic plant.

namespace tether {
namespace {

using test::contents;
using test::Folder;
using test::run_and_hash;
using test::run_into;
using ::testing::HasSubstr;
using ::testing::Not;

Scenario on_plant(std::vector<std::string> overrides, bool kinematic = true) {
  if (kinematic) overrides.emplace_back("vehicle.plant=kinematic");
  return load_scenario(in_source("/scenarios/paper.toml"), overrides);
}

double epsilon_m(const Scenario& scenario) {
  ClosedLoop loop(scenario);
  loop.run();
  return loop.sim().metrics().epsilon_m();
}

TEST(KinematicLoop, EpsilonWithoutImpairmentIsThatOfOde) {
  const double ode = epsilon_m(on_plant({}, false));
  EXPECT_NEAR(epsilon_m(on_plant({})), ode, 0.01 * ode);
  EXPECT_NEAR(ode, 1.732, 0.005);
}

TEST(KinematicLoop, EpsilonWithDelayIsThatOfOde) {
  const double ode = epsilon_m(on_plant({"channel.delay_ms=500"}, false));
  EXPECT_NEAR(epsilon_m(on_plant({"channel.delay_ms=500"})), ode, 0.01 * ode);
}

TEST(KinematicLoop, SameScenarioAndSeedGiveByteIdenticalFiles) {
  const std::vector<std::string> lossy{"channel.prr=0.45", "run.seed=7", "run.duration_s=30"};
  EXPECT_EQ(run_and_hash(on_plant(lossy)), run_and_hash(on_plant(lossy)));
}

TEST(KinematicLoop, HowOftenTheTruthIsLookedAtDoesNotChangeTheRun) {
  const double e = epsilon_m(on_plant({"channel.prr=0.45"}));
  for (const char* rate : {"7.3", "1000", "0.1"}) {
    EXPECT_EQ(epsilon_m(on_plant({"channel.prr=0.45", std::string("run.truth_rate_hz=") + rate})),
              e);
  }
}

std::vector<TrajectoryRow> trajectory(const Scenario& scenario) {
  ClosedLoop loop(scenario);
  const RunObserver observer(scenario, loop.loop(), loop.bus());
  loop.run();
  return observer.trajectory();
}

/// In a corner, where no vehicle comes: with obstacles, it moves step by step.
Scenario with_obstacle(Scenario scenario) {
  const double corner_m = scenario.get<WorldSettings>().half_extent_m - 0.2;
  scenario.get<Surroundings>().obstacles.push_back(
      {.kind = Obstacle::Kind::cylinder, .pose = {corner_m, corner_m, 0.0}, .radius_m = 0.1});
  return scenario;
}

TEST(KinematicLoop, StepsTakenAtOnceLeadWhereStepsOneByOneDo) {
  for (const std::vector<std::string>& overrides :
       {std::vector<std::string>{},
        {"sensor.rate_hz=20"},
        {"channel.prr=0.6", "actuator.policy=ramp", "actuator.timeout_s=1.5"},
        {"controller.law=predictive_consistent", "controller.trigger=timer",
         "controller.rate_hz=10", "actuator.policy=horizon", "channel.prr=0.7"}}) {
    const Scenario one_by_one = with_obstacle(on_plant(overrides));
    const auto a = trajectory(on_plant(overrides)), b = trajectory(one_by_one);
    ASSERT_EQ(a.size(), b.size());
    double apart_m = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      apart_m = std::max(apart_m, std::hypot(a[i].x_m - b[i].x_m, a[i].y_m - b[i].y_m));
    }
    EXPECT_LT(apart_m, 1e-6) << overrides.size();
    EXPECT_NEAR(epsilon_m(on_plant(overrides)), epsilon_m(one_by_one), 1e-6);
  }
}

TEST(KinematicLoop, PlansOfTenSecondsAreEnoughForAMinuteWithoutAnyPose) {
  const Scenario blind =
      on_plant({"controller.law=predictive_consistent", "controller.trigger=timer",
                "controller.rate_hz=10", "controller.horizon_s=10", "actuator.policy=horizon",
                "channel.uplink.prr=0", "channel.downlink.prr=0.5"});
  EXPECT_LT(epsilon_m(blind), 0.1);
}

TEST(KinematicLoop, MetricsCoverRunsOfAnyLength) {
  // A vehicle that stands: the largest error is the last one, at 2.345 s.
  ClosedLoop loop(on_plant({"channel.prr=0", "run.duration_s=2.345"}));
  loop.run();
  const double theta = 0.1 * 2.345;
  EXPECT_NEAR(loop.sim().metrics().max_error_m(),
              20.0 * std::sin(theta) * std::hypot(1.0, std::cos(theta)), 1e-9);
}

TEST(KinematicLoop, EveryOutputSaysWhichPlantItCameFrom) {
  const Folder folder;
  for (const bool kinematic : {true, false}) {
    const auto out = folder.path / (kinematic ? "kinematic" : "ode");
    run_into(out, on_plant({"run.duration_s=2"}, kinematic));
    EXPECT_EQ(nlohmann::json::parse(contents(out / "summary.json"))["plant"],
              kinematic ? "kinematic" : "ode");
    EXPECT_EQ(contents(out / "path.gp").find("kinematic plant; ") != std::string::npos, kinematic);
  }
}

TEST(KinematicLoop, TheResolvedScenarioHoldsNoMassesAndGivesTheSameRun) {
  const Scenario scenario = on_plant({"channel.prr=0.45", "run.duration_s=30", "run.seed=4"});
  const std::string text = to_toml(scenario);
  EXPECT_THAT(text, HasSubstr("plant = \"kinematic\""));
  EXPECT_THAT(text, HasSubstr("wall_friction"));
  for (const char* key : {"mass_kg", "torque", "\nfriction", "gravity", "caster", "height"}) {
    EXPECT_THAT(text, Not(HasSubstr(key)));
  }
  EXPECT_EQ(run_and_hash(scenario), run_and_hash(parse_scenario(text, "resolved")));
}

TEST(KinematicLoop, KeysWithoutEffectAreRefusedAtTheLevelWhereTheyAreGiven) {
  EXPECT_NO_THROW(on_plant({}));  // the file has friction and torque, for the plant that it names
  try {
    on_plant({"world.friction=0.5"});
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(),
                 "--set: world.friction has no effect: vehicle.plant is \"kinematic\"");
  }
  EXPECT_THROW(parse_scenario("[vehicle]\nplant = \"kinematic\"\ncaster_mass_kg = 1.0", "a.toml"),
               UsageError);
}

}  // namespace
}  // namespace tether
