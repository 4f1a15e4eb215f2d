// Disturbances of the vehicle and its sensors, in the whole loop: only the simulator knows them.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <tether/odometry_t.hpp>
#include <variant>
#include <vector>

#include "common/node/message_io.hpp"
#include "controller/laws/law.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/nodes/closed_loop.hpp"

namespace tether {
namespace {

using test::contents;
using test::Folder;
using test::run_into;

Scenario loaded(const std::vector<std::string>& overrides, const char* file = "paper.toml") {
  return load_scenario(in_source("/scenarios/") + std::string(file), overrides);
}

const std::vector<std::string> kUncertain{"vehicle.start_error_m=0.2",
                                          "vehicle.start_error_rad=0.1"};

std::vector<std::string> uncertain(std::vector<std::string> more) {
  more.insert(more.end(), kUncertain.begin(), kUncertain.end());
  return more;
}

Pose2 start_of(const Scenario& scenario) {
  ClosedLoop loop(scenario);
  return loop.sim().vehicle().state().pose;
}

TEST(UncertainStart, IsTheSameWithAnyPlantAndDrivetrain) {
  const Pose2 ode = start_of(loaded(kUncertain));
  EXPECT_GT(std::hypot(ode.x_m, ode.y_m), 0.01);
  EXPECT_GT(std::abs(ode.yaw_rad), 0.001);
  const Pose2 kinematic = start_of(loaded(uncertain({"vehicle.plant=kinematic"})));
  EXPECT_NEAR(kinematic.x_m, ode.x_m, 1e-12);
  EXPECT_NEAR(kinematic.y_m, ode.y_m, 1e-12);
  EXPECT_NEAR(kinematic.yaw_rad, ode.yaw_rad, 1e-12);
  const Pose2 can = start_of(loaded(kUncertain, "hil_vcan.toml"));
  EXPECT_NEAR(can.x_m, ode.x_m, 1e-12);
}

TEST(UncertainStart, IsAnotherWithAnotherSeed) {
  EXPECT_NE(start_of(loaded(uncertain({"run.seed=2"}))).x_m,
            start_of(loaded(uncertain({"run.seed=3"}))).x_m);
}

TEST(UncertainStart, PlansBeginAtTheNominalOne) {
  const std::vector<std::string> predictive{"controller.law=predictive", "actuator.policy=horizon"};
  const auto first_twists = [](const Scenario& scenario) {
    return std::get<Plan>(make_law(scenario)->decide(kStart, nullptr)).twists;
  };
  const auto with = first_twists(loaded(uncertain(predictive)));
  const auto without = first_twists(loaded(predictive));
  ASSERT_EQ(with.size(), without.size());
  for (std::size_t i = 0; i < with.size(); ++i) {
    EXPECT_EQ(with[i].v_mps, without[i].v_mps);
    EXPECT_EQ(with[i].omega_radps, without[i].omega_radps);
  }
}

TEST(UncertainStart, TheErrorStaysForAVehicleThatDrivesAPreloadedPlanUnseen) {
  const std::vector<std::string> blind{"controller.law=predictive",
                                       "actuator.policy=horizon",
                                       "controller.preload=true",
                                       "controller.horizon_s=30",
                                       "run.duration_s=20",
                                       "vehicle.plant=kinematic",
                                       "channel.prr=0"};
  ClosedLoop certain(loaded(blind));
  certain.run();
  ClosedLoop off(loaded(uncertain(blind)));
  off.run();
  EXPECT_LT(certain.sim().metrics().epsilon_m(), 0.1);
  EXPECT_GT(off.sim().metrics().epsilon_m(), 0.2);
}

TEST(UncertainStart, TheResolvedScenarioReproducesIt) {
  const Folder folder;
  run_into(folder.path / "a", loaded(uncertain({"run.duration_s=3", "run.seed=5"})));
  run_into(folder.path / "b", load_scenario((folder.path / "a" / "scenario.toml").string(), {}));
  EXPECT_EQ(contents(folder.path / "a" / "run.lcmlog"), contents(folder.path / "b" / "run.lcmlog"));
}

double disturbed_epsilon_m(const Scenario& scenario) {
  ClosedLoop loop(scenario);
  loop.run();
  return loop.sim().metrics().epsilon_m();
}

TEST(ControlledPoint, TheChassisCentreIsCloserToThePapersPathThanTheAxle) {
  EXPECT_NEAR(disturbed_epsilon_m(loaded({"path.point=axle"})), 1.7324, 1e-3);
  EXPECT_NEAR(disturbed_epsilon_m(loaded({"path.point=chassis"})), 1.5141, 1e-3);
}

TEST(ControlledPoint, LawsForTheAxleTakeTheChassisCentreAlongThePathAsWell) {
  const std::vector<std::string> tracking{"controller.law=tracking", "sensor.rate_hz=20",
                                          "vehicle.plant=kinematic", "run.duration_s=30"};
  std::vector<std::string> predictive{tracking};
  predictive[0] = "controller.law=predictive";
  predictive.emplace_back("actuator.policy=horizon");
  for (auto law : {tracking, predictive}) {
    const double axle = disturbed_epsilon_m(loaded(law));
    law.emplace_back("path.point=chassis");
    EXPECT_LT(disturbed_epsilon_m(loaded(law)), axle)
        << law[0];  // it begins 0.5 m nearer to the path
  }
}

TEST(Odometry, ReachesTheControllerAndChangesNothingForLawsThatDoNotUseIt) {
  const std::vector<std::string> lossy{"vehicle.plant=kinematic", "channel.prr=0.6",
                                       "channel.delay_ms=50", "run.duration_s=20"};
  std::vector<std::string> with{lossy};
  with.emplace_back("sensor.odometry_rate_hz=50");
  ClosedLoop loop(loaded(with));
  std::int64_t undecodable = 0, arrived = 0;
  subscribe<odometry_t>(loop.bus(), "CTRL/ODOMETRY", kDeepQueue, undecodable,
                        [&](const odometry_t&) { ++arrived; });
  loop.run();
  EXPECT_EQ(loop.sim().metrics().epsilon_m(), disturbed_epsilon_m(loaded(lossy)));
  // 1001 in all, some of the last under way: 600 get through, with a deviation of √(1000 · 0.24)
  // = 15.5.
  EXPECT_NEAR(static_cast<double>(arrived), 600.0, 4.0 * 15.5);
}

}  // namespace
}  // namespace tether
