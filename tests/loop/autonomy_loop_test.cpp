#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tether/autonomy_state_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>

#include "common/base/random.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/loop/lockstep_rig.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"

namespace tether {
namespace {

constexpr const char* kLine = R"(
[run]
duration_s = 70.0
lead_s = 2.0
[world]
half_extent_m = 18.0
[vehicle]
plant = "kinematic"
start_x_m = -15.0
[sensor]
rate_hz = 20.0
odometry_rate_hz = 50.0
[lidar]
model = "custom"
[path]
kind = "line"
start_x_m = -15.0
length_m = 28.0
speed_mps = 1.2
[controller]
law = "detour"
trigger = "timer"
rate_hz = 20.0
[autonomy]
enabled = true
)";

constexpr const char* kBox = R"(
[[world.obstacle]]
kind = "box"
x_m = 0.0
y_m = 0.0
mapped = false
)";

/// Crosses the path again and again, and no map has it.
constexpr const char* kTrolley = R"(
[[world.obstacle]]
kind = "box"
x_m = 0.0
y_m = 6.0
to = [[0.0, -6.0]]
speed_mps = 1.0
pause_s = 0.5
)";

/// A vehicle that drives by itself, and what it said.
struct Journey {
  explicit Journey(const std::string& obstacles, const std::vector<std::string>& overrides = {})
      : loop(parse_scenario(kLine + obstacles, "test", overrides)) {
    subscribe<autonomy_state_t>(loop.bus(), "AGV/AUTONOMY", kDeepQueue, undecodable,
                                [this](const autonomy_state_t& m) { reports.push_back(m); });
    loop.run();
  }
  double x_m() { return loop.sim().vehicle().state().pose.x_m; }
  bool touched() const { return loop.sim().metrics().wall_contact_s() > 0.0; }

  ClosedLoop loop;
  std::int64_t undecodable = 0;
  std::vector<autonomy_state_t> reports;
};

TEST(AutonomyLoop, OnAFreePathTheVehicleDrivesByItselfWithoutAnyNetwork) {
  Journey run("", {"channel.prr=0"});
  EXPECT_NEAR(run.x_m(), 13.0, 0.05);
  EXPECT_EQ(run.reports.back().state, autonomy_state_t::AUTONOMOUS);
  EXPECT_EQ(run.reports.back().handover, 0);
  EXPECT_LT(run.reports.back().late_s, 0.3);
}

TEST(AutonomyLoop, ABoxOnThePathStopsItInTimeAndItAsksForHelp) {
  Journey run(kBox, {"channel.prr=0"});
  EXPECT_EQ(run.reports.back().state, autonomy_state_t::REMOTE_REQUESTED);
  const double gap_m = -0.5 - (run.x_m() + 1.5);
  EXPECT_GT(gap_m, 0.25);
  EXPECT_LT(gap_m, 0.40);
  EXPECT_GT(run.reports.back().count, 5);
}

TEST(AutonomyLoop, ItLetsATrolleyPassAndGoesOnByItself) {
  Journey run(kTrolley, {"channel.prr=0", "run.duration_s=120", "autonomy.wait_s=20"});
  EXPECT_EQ(run.reports.back().state, autonomy_state_t::AUTONOMOUS);
  EXPECT_EQ(run.reports.back().handover, 0);
  EXPECT_NEAR(run.x_m(), 13.0, 0.1);
  EXPECT_FALSE(run.touched());
}

TEST(AutonomyLoop, WhileItDoesNotKnowWhereItIsItSaysThatAndNoPlace) {
  Journey run("", {"run.duration_s=30", "sensor.dropouts_per_min=6", "sensor.dropout_s=3"});
  int unknown = 0, known = 0;
  for (const autonomy_state_t& m : run.reports) {
    const bool lost = std::isnan(m.x_m);
    EXPECT_EQ(std::isnan(m.y_m), lost);
    EXPECT_EQ(std::isnan(m.yaw_rad), lost);
    (lost ? unknown : known) += 1;
    if (lost) {
      EXPECT_NE(m.state, autonomy_state_t::AUTONOMOUS);
      EXPECT_EQ(m.count, 0);
    } else {
      EXPECT_LT(m.x_m, 13.1);
      EXPECT_GT(m.x_m, -15.1);
      EXPECT_NEAR(m.y_m, 0.0, 0.1);
    }
  }
  EXPECT_GT(unknown, 20);
  EXPECT_GT(known, 100);
}

/// The states in the order in which they were entered.
std::vector<std::int32_t> states(const Journey& run) {
  std::vector<std::int32_t> states;
  for (const autonomy_state_t& m : run.reports) {
    if (states.empty() || states.back() != m.state) states.push_back(m.state);
  }
  return states;
}

TEST(AutonomyLoop, TheRemoteDriverTakesItAroundABoxAndItGoesOnByItself) {
  Journey run(kBox);
  using A = autonomy_state_t;
  EXPECT_EQ(states(run), (std::vector<std::int32_t>{A::PROTECTIVE_STOP, A::AUTONOMOUS,
                                                    A::PROTECTIVE_STOP, A::REMOTE_REQUESTED,
                                                    A::REMOTE, A::RETURNING, A::AUTONOMOUS}));
  EXPECT_NEAR(run.x_m(), 13.0, 0.1);
  EXPECT_EQ(run.reports.back().handover, 2);
  EXPECT_LT(run.reports.back().late_s, 45.0);
  EXPECT_FALSE(run.touched());
}

TEST(AutonomyLoop, ItDoesSoWhenTwoOfThreePacketsAreLost) {
  for (const char* prr : {"channel.prr=0.6", "channel.prr=0.3"}) {
    Journey run(kBox, {prr});
    EXPECT_EQ(run.reports.back().state, autonomy_state_t::AUTONOMOUS) << prr;
    EXPECT_NEAR(run.x_m(), 13.0, 0.1) << prr;
  }
}

/// The remote driver's twists as plans: each for half a second from when it was decided, then zero.
/// They alone reach the vehicle, some of them, and late.
struct PlannedJourney {
  PlannedJourney(double prr, Duration delay)
      : loop(parse_scenario(kLine + std::string(kBox), "test",
                            {"actuator.policy=horizon", "channel.downlink.prr=0"})) {
    subscribe<twist_t>(loop.bus(), "CTRL/CMD_VEL", kDeepQueue, undecodable,
                       [this, prr, delay](const twist_t& m) {
                         if (uniform_01(luck) >= prr) return;
                         loop.loop().at(loop.loop().now() + delay, Priority::delivery,
                                        [this, m](Instant) { send(m); });
                       });
    subscribe<twist_t>(loop.bus(), "AGV/DRIVE", kDeepQueue, undecodable, [this](const twist_t& m) {
      largest_step_mps = std::max(largest_step_mps, std::abs(m.v_mps - before_mps));
      before_mps = m.v_mps;
    });
    subscribe<autonomy_state_t>(loop.bus(), "AGV/AUTONOMY", kDeepQueue, undecodable,
                                [this](const autonomy_state_t& m) { last = m; });
    subscribe<counters_t>(loop.bus(), "AGV/COUNTERS", kDeepQueue, undecodable,
                          [this](const counters_t& m) {
                            for (std::size_t i = 0; i < m.name.size(); ++i)
                              counters[m.name[i]] = m.value[i];
                          });
    loop.run();
  }
  void send(const twist_t& m) {
    plan_t plan{};
    plan.utime = plan.start_utime = m.utime;
    plan.seq = plan.id = m.seq;
    plan.run = m.run;
    plan.session = 1;
    plan.based_on = plan.based_on_last = plan_t::ANY;
    plan.pose_utime = m.pose_utime;
    plan.step_us = 100'000;
    plan.count = 6;
    plan.v_mps.assign(5, static_cast<float>(m.v_mps));
    plan.omega_radps.assign(5, static_cast<float>(m.omega_radps));
    plan.v_mps.push_back(0.0F);
    plan.omega_radps.push_back(0.0F);
    publish(loop.bus(), "AGV/PLAN", plan);
  }

  ClosedLoop loop;
  RandomEngine luck = random_stream(1, "plans");
  std::int64_t undecodable = 0;
  double before_mps = 0.0, largest_step_mps = 0.0;
  autonomy_state_t last{};
  std::map<std::string, std::int64_t> counters;
};

TEST(AutonomyLoop, ItDoesSoByPlansWhichMayBeLateAndLost) {
  for (const auto& [prr, delay_ms] : {std::pair{1.0, 0}, {0.5, 150}}) {
    PlannedJourney run(prr, std::chrono::milliseconds{delay_ms});
    EXPECT_EQ(run.last.state, autonomy_state_t::AUTONOMOUS) << prr;
    EXPECT_EQ(run.last.handover, 2) << prr;
    EXPECT_NEAR(run.loop.sim().vehicle().state().pose.x_m, 13.0, 0.1) << prr;
    EXPECT_EQ(run.loop.sim().metrics().wall_contact_s(), 0.0) << prr;
    EXPECT_GT(run.counters["plan.accepted"], 100) << prr;
    EXPECT_LE(run.largest_step_mps, 0.02 + 1e-9) << "1 m/s^2 at 50 Hz";
  }
}

TEST(AutonomyLoop, ItDoesSoWithDrivesOnCan) {
  Journey run(kBox, {"vehicle.drivetrain=can", "vehicle.plant=ode", "run.lead_s=6",
                     "can.drivetrain=" + in_source("/drivetrains/dual_axis_cia402.toml")});
  EXPECT_EQ(run.reports.back().state, autonomy_state_t::AUTONOMOUS);
  EXPECT_NEAR(run.x_m(), 13.0, 0.1);
}

TEST(AutonomyLoop, LawsThatNeedTheNameOfThePlanInForceAreRefused) {
  const auto with = [](const std::vector<std::string>& overrides) {
    return refusal_of([&] { parse_scenario(kLine, "test", overrides); });
  };
  const std::string plans = "actuator.policy=horizon";
  for (const std::string law : {"predictive", "predictive_consistent", "mpc"}) {
    EXPECT_THAT(
        with({"controller.law=" + law, plans}),
        ::testing::HasSubstr("controller.law = \"" + law + "\" plans from the plan in force"));
    EXPECT_EQ(with({"controller.law=" + law, plans, "controller.external=true"}), "accepted");
  }
  EXPECT_EQ(with({}), "accepted");
}

TEST(AutonomyLoop, LawsThatNeverTakeOverAreRefusedAndSoIsARemoteDriverWithoutAVehicle) {
  const auto with = [](const std::vector<std::string>& overrides) {
    return refusal_of([&] { parse_scenario(kLine, "test", overrides); });
  };
  for (const std::string law : {"pid", "pid_adaptive", "tracking", "tracking_compensated"}) {
    std::vector<std::string> set{"controller.law=" + law,
                                 "controller.tau_table=" + in_source("/scenarios/tau_table.csv")};
    EXPECT_THAT(with(set), ::testing::HasSubstr("test: controller.law = \"" + law +
                                                "\" never takes over a vehicle that drives by "
                                                "itself (autonomy.enabled = true): controller.law "
                                                "must be \"detour\""));
    set.emplace_back("controller.external=true");
    EXPECT_EQ(with(set), "accepted");
  }
  EXPECT_THAT(with({"autonomy.enabled=false"}),
              ::testing::HasSubstr("test: controller.law = \"detour\" drives only when a vehicle "
                                   "asks for it, and autonomy.enabled is false"));
  EXPECT_THAT(with({"autonomy.enabled=false"}),
              ::testing::HasSubstr("or controller.law one of \"pid\", \"pid_adaptive\""));
}

TEST(AutonomyLoop, AScannerFromWhichTheVehicleHidesTheWayAheadIsRefused) {
  const auto refusal = [](const std::vector<std::string>& overrides) {
    return refusal_of([&] { parse_scenario(kLine, "test", overrides); });
  };
  const char* kHidden = "does not see the way ahead";
  EXPECT_THAT(refusal({"lidar.mount_x_m=-0.5"}), ::testing::HasSubstr(kHidden)) << "at the rear";
  EXPECT_THAT(refusal({"lidar.mount_x_m=0", "lidar.mount_y_m=1"}), ::testing::HasSubstr(kHidden))
      << "at the side";
  EXPECT_THAT(refusal({"lidar.mount_yaw_rad=3.14"}), ::testing::HasSubstr(kHidden)) << "looks back";
  EXPECT_EQ(refusal({"lidar.mount_x_m=0", "lidar.height_m=1"}), "accepted")
      << "looks over the vehicle";
}

TEST(AutonomyLoop, AScannerBetweenWhoseBeamsAVehicleHasRoomIsRefused) {
  EXPECT_THAT(refusal_of([&] { parse_scenario(kLine, "test", {"lidar.beams=4"}); }),
              ::testing::HasSubstr("test: lidar.beams = 4: at the end of the stopping field, "));
}

TEST(AutonomyLoop, TheResolvedScenarioHasTheGainsOfTheLawOnBoard) {
  const Scenario s = parse_scenario(kLine, "test", {"controller.tracking.k_x=1.25"});
  EXPECT_THAT(to_toml(s), ::testing::HasSubstr("k_x = 1.25"));
  EXPECT_EQ(to_toml(parse_scenario(to_toml(s), "again", {})), to_toml(s));
}

// A box 4 m ahead: it stops, asks and is driven remotely within the run.
TEST(AutonomyLoop, IsTheSameInLockstep) {
  constexpr const char* kNear = R"(
[[world.obstacle]]
kind = "box"
x_m = -9.0
y_m = 0.0
mapped = false
)";
  const Scenario s = parse_scenario(kLine + std::string(kNear), "test",
                                    {"run.duration_s=12", "autonomy.wait_s=1", "lidar.rate_hz=10",
                                     "channel.prr=0.8", "channel.delay_ms=20"});
  test::LockstepRig rig(s);
  std::int64_t undecodable = 0, remote = 0;
  subscribe<autonomy_state_t>(rig.network, "AGV/AUTONOMY", kDeepQueue, undecodable,
                              [&remote](const autonomy_state_t& m) {
                                remote += m.state == autonomy_state_t::REMOTE ? 1 : 0;
                              });
  rig.run();
  ASSERT_EQ(rig.manager->error(), "");
  EXPECT_GT(remote, 10);
  EXPECT_TRUE(rig.record == test::record_of(s));
}

}  // namespace
}  // namespace tether
