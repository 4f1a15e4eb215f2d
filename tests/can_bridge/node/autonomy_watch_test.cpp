#include <gtest/gtest.h>

#include <limits>

#include "can_bridge/node/can_bridge_node.hpp"
#include "common/scenario/scenario.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;

constexpr Duration kTick = std::chrono::nanoseconds{1};
constexpr Duration kFresh = AutonomyWatch::kFresh;

/// A watch with a = 1 m/s², 0.2 s and a margin of 0.3 m, and what it hears.
struct AutonomyWatchTest : ::testing::Test {
  test::VirtualWorld world;
  Scenario scenario;
  std::optional<AutonomyWatch> watch;
  std::int64_t seq = 0;

  AutonomyWatchTest() {
    scenario.get<CanSettings>().max_speed_mps = 2.0;
    watch.emplace(scenario, world.loop, world.bus);
  }
  autonomy_state_t report(Instant stamp, double clear_m) {
    autonomy_state_t m{};
    m.utime = to_utime(stamp);
    m.seq = seq++;
    m.clear_m = clear_m;
    return m;
  }
  void hear(Instant when, const autonomy_state_t& m) {
    world.publish_at(when, "AGV/AUTONOMY", m);
    world.loop.run_until(when);
  }
  void hear(Instant when, double clear_m) { hear(when, report(when, clear_m)); }
  SafetyDemands demands(Instant now, double speed_mps = 0.0,
                        SafetyDemands of_inputs = SafetyDemands()) const {
    watch->demand(now, speed_mps, of_inputs);
    return of_inputs;
  }
  std::int64_t count(const std::string& name) const {
    CounterList list;
    watch->list(list);
    for (const auto& [key, value] : list) {
      if (key == name) return value;
    }
    return -1;
  }
};

TEST_F(AutonomyWatchTest, BeforeTheFirstReportTheVehicleStopsByTheRampAndMayGoOn) {
  const SafetyDemands all = demands(kStart);
  EXPECT_EQ(all.stop, "autonomy: not heard yet");
  EXPECT_TRUE(all.ramp);
  EXPECT_TRUE(all.may_resume);
  EXPECT_EQ(all.estop, "");
}

TEST_F(AutonomyWatchTest, AReportHoldsForThreeTenthsOfASecondAndNotATickLonger) {
  const Instant heard = at_ms(1000);
  hear(heard, 5.0);
  for (const Duration age : {Duration{0}, kFresh - kTick, kFresh}) {
    EXPECT_EQ(demands(heard + age).stop, "") << age.count();
  }
  EXPECT_EQ(demands(heard + kFresh + kTick).stop, "autonomy: silent for 300 ms");
  EXPECT_EQ(demands(heard + std::chrono::seconds{2}).stop, "autonomy: silent for 2000 ms");
}

TEST_F(AutonomyWatchTest, SilenceEndsWithTheNextReport) {
  hear(at_ms(1000), 5.0);
  hear(at_ms(2000), 5.0);
  EXPECT_EQ(demands(at_ms(2000) + kFresh).stop, "");
  EXPECT_NE(demands(at_ms(2000) + kFresh + kTick).stop, "");
}

// The field of 1 m/s is 1 m long; at 0.5 m/s it is 0.525 m.
TEST_F(AutonomyWatchTest, AFieldThatReachesTwoDecimetresBeyondTheClearWayIsAStop) {
  hear(at_ms(1000), 0.8);
  EXPECT_EQ(demands(at_ms(1000), 1.0 - 1e-6).stop, "");
  EXPECT_EQ(demands(at_ms(1000), 1.0 + 1e-6).stop, "autonomy: 0.80 m free, 1.00 m needed to stop");
  EXPECT_NE(demands(at_ms(1000), -1.0 - 1e-6).stop, "") << "backwards as well";
  hear(at_ms(1100), 0.325);
  EXPECT_EQ(demands(at_ms(1100), 0.5 - 1e-6).stop, "");
  EXPECT_NE(demands(at_ms(1100), 0.5 + 1e-6).stop, "");
}

TEST_F(AutonomyWatchTest, AVehicleThatStandsBeforeAnObstacleNeedNotStopAndMayNotMove) {
  hear(at_ms(1000), 0.0);
  const SafetyDemands all = demands(at_ms(1000), 0.0);
  EXPECT_EQ(all.stop, "");
  EXPECT_EQ(all.speed_limit_mps, 0.0);
  EXPECT_EQ(all.speed_limit_by, "autonomy");
}

// √(0.04 + 2·0.7) − 0.2 = 1.0 m/s fits into 1 m; 2 m/s needs 2.7 m.
TEST_F(AutonomyWatchTest, LimitsTheSpeedToWhatFitsAndOnlyBelowTheVehiclesOwnLimit) {
  hear(at_ms(1000), 1.0);
  EXPECT_NEAR(demands(at_ms(1000)).speed_limit_mps.value_or(-1.0), 1.0, 1e-12);
  hear(at_ms(1100), 2.7 - 1e-6);
  EXPECT_NEAR(demands(at_ms(1100)).speed_limit_mps.value_or(-1.0), 2.0, 1e-6);
  hear(at_ms(1200), 2.7 + 1e-6);
  EXPECT_FALSE(demands(at_ms(1200)).speed_limit_mps);
}

SafetyDemands limited_to(double speed_mps) {
  SafetyDemands demands;
  demands.speed_limit_mps = speed_mps;
  demands.speed_limit_by = "gate";
  return demands;
}

TEST_F(AutonomyWatchTest, OfTwoLimitsTheLowerOneHolds) {
  hear(at_ms(1000), 1.0);
  const SafetyDemands lower = demands(at_ms(1000), 0.0, limited_to(0.3));
  EXPECT_EQ(lower.speed_limit_mps, 0.3);
  EXPECT_EQ(lower.speed_limit_by, "gate");
  const SafetyDemands higher = demands(at_ms(1000), 0.0, limited_to(1.5));
  EXPECT_NEAR(higher.speed_limit_mps.value_or(-1.0), 1.0, 1e-12);
  EXPECT_EQ(higher.speed_limit_by, "autonomy");
}

TEST_F(AutonomyWatchTest, AStopOfASafetyInputKeepsItsKindAndBothSayWhy) {
  SafetyDemands bumper;
  bumper.stop = "bumper";
  const SafetyDemands all = demands(kStart, 0.0, bumper);
  EXPECT_EQ(all.stop, "bumper; autonomy: not heard yet");
  EXPECT_FALSE(all.ramp);
  EXPECT_FALSE(all.may_resume);
}

TEST_F(AutonomyWatchTest, WhatIsDamagedLateOrOfAnotherRunRefreshesNothing) {
  const autonomy_state_t first = report(at_ms(1000), 5.0);
  hear(at_ms(1000), first);
  hear(at_ms(1200), first);
  autonomy_state_t other = report(at_ms(1200), 5.0);
  other.run = 7;
  hear(at_ms(1210), other);
  world.publish_bytes_at(at_ms(1220), "AGV/AUTONOMY", {1, 2, 3});
  world.loop.run_until(at_ms(1220));
  EXPECT_NE(demands(at_ms(1000) + kFresh + kTick).stop, "");
  EXPECT_EQ(count("autonomy.accepted"), 1);
  EXPECT_EQ(count("autonomy.duplicated"), 1);
  EXPECT_EQ(count("autonomy.other_run"), 1);
  EXPECT_EQ(count("autonomy.undecodable"), 1);
}

TEST_F(AutonomyWatchTest, AClearWayThatIsNoNumberIsNone) {
  hear(at_ms(1000), std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(demands(at_ms(1000), 0.0).speed_limit_mps, 0.0);
  EXPECT_NE(demands(at_ms(1000), 0.1).stop, "");
}

}  // namespace
}  // namespace tether
