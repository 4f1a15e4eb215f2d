#include "can_bridge/safety/follow_monitor.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/can_bridge/safety/rig.hpp"

namespace tether::test {
namespace {

constexpr double kTrack_m = 1.2, kRadius_m = 0.4;

struct FollowMonitorTest : ::testing::Test {
  FollowMonitor monitor{kTrack_m, kRadius_m};
  std::array<WheelFeedback, 2> wheels;
  Instant now = kStart;
  std::string trouble;

  FollowMonitorTest() {
    for (WheelFeedback& w : wheels) w.valid = true;
    monitor.update(now, {}, wheels);
  }
  /// One cycle in which the wheels' rims turn at these speeds. False once there is trouble.
  bool cycle(const Twist& setpoint, double left_mps, double right_mps) {
    now += kCycle;
    wheels[0].angle_rad += left_mps * 0.02 / kRadius_m;
    wheels[1].angle_rad += right_mps * 0.02 / kRadius_m;
    trouble = monitor.update(now, setpoint, wheels);
    return trouble.empty();
  }
  /// How long until there is trouble, at most 100 s.
  Duration time_to_trouble(const Twist& setpoint, double left_mps, double right_mps) {
    const Instant began = now;
    while (now - began < seconds{100} && cycle(setpoint, left_mps, right_mps)) {
    }
    return now - began;
  }
};

TEST_F(FollowMonitorTest, WheelsThatFollowAreFine) {
  EXPECT_EQ(time_to_trouble({2.0, 1.0}, 1.4, 2.6), seconds{100});
  EXPECT_EQ(time_to_trouble({-1.0, 0.0}, -0.9, -0.9), seconds{100});
}

TEST_F(FollowMonitorTest, AFrozenWheelIsNoticedTheSoonerTheFasterItShouldTurn) {
  EXPECT_EQ(time_to_trouble({2.8, 0.0}, 2.8, 0.0), milliseconds{100});  // 0.15 m at 1.86 m/s: 81 ms
  EXPECT_NE(trouble.find("the right wheel does not follow: told 2.80 m/s"), std::string::npos);
  monitor.reset();
  monitor.update(now, {}, wheels);
  EXPECT_EQ(time_to_trouble({-0.3, 0.0}, 0.0, -0.3), milliseconds{1320});
  EXPECT_NE(trouble.find("the left wheel"), std::string::npos);
}

TEST_F(FollowMonitorTest, ASlowWheelThatIsFrozenIsNoticedWithinSeconds) {
  EXPECT_LE(time_to_trouble({0.1, 0.0}, 0.1, 0.0), milliseconds{5020});
  EXPECT_NE(trouble.find("the right wheel does not follow: told 0.10 m/s"), std::string::npos);
  monitor.reset();
  monitor.update(now, {}, wheels);
  EXPECT_EQ(time_to_trouble({0.028, 0.0}, 0.028, 0.0), seconds{100}) << "as good as none";
}

TEST_F(FollowMonitorTest, AWheelThatCreepsWhileItShouldStandIsNoticedWithinSeconds) {
  EXPECT_LE(time_to_trouble({}, 0.1, 0.0), milliseconds{3160});
  EXPECT_NE(trouble.find("the left wheel does not follow: told 0.00 m/s"), std::string::npos);
  monitor.reset();
  monitor.update(now, {}, wheels);
  EXPECT_LE(time_to_trouble({}, 0.0, -0.05), milliseconds{8360});
  monitor.reset();
  monitor.update(now, {}, wheels);
  EXPECT_EQ(time_to_trouble({}, 0.019, -0.019), seconds{100});
}

TEST_F(FollowMonitorTest, AWheelOfWrongSignOrThatRunsAwayIsNoticed) {
  EXPECT_LE(time_to_trouble({1.0, 0.0}, 1.0, -1.0), milliseconds{100});
  monitor.reset();
  monitor.update(now, {}, wheels);
  EXPECT_LE(time_to_trouble({0.0, 0.0}, 0.0, 1.0), milliseconds{180});
}

TEST_F(FollowMonitorTest, AWheelAtSevenTenthsOfItsSetpointIsNoticedWithinFourAndAHalfMeters) {
  for (const double v_mps : {1.0, -1.0, 2.8}) {
    monitor.reset();
    monitor.update(now, {}, wheels);
    const Duration took = time_to_trouble({v_mps, 0.0}, v_mps, 0.7 * v_mps);
    EXPECT_LE(to_seconds(took) * std::abs(v_mps), 4.5) << v_mps;
    EXPECT_NE(trouble.find("the right wheel does not follow"), std::string::npos);
  }
}

TEST_F(FollowMonitorTest, TheSmallestErrorThatIsSeenIsATenthAndTwentyMillimetersASecond) {
  EXPECT_EQ(time_to_trouble({1.0, 0.0}, 1.0 - 0.119, 1.119), seconds{100});
  EXPECT_LT(time_to_trouble({1.0, 0.0}, 1.0, 1.0 - 0.13), seconds{100});
}

TEST_F(FollowMonitorTest, ADriveThatLagsBehindItsRampPasses) {
  constexpr int kLagCycles = 10;  // 0.2 s
  constexpr double kStep_mps = 1.5 * 0.02;
  std::vector<double> set;
  for (double v = 0.0; v < 3.0; v += kStep_mps) set.push_back(v);
  for (double v = 3.0; v > -3.0; v -= kStep_mps) set.push_back(v);
  for (double v = -3.0; v < 0.0; v += kStep_mps) set.push_back(v);
  set.insert(set.end(), 100, 0.0);
  for (std::size_t i = 0; i < set.size(); ++i) {
    const double turned = i < kLagCycles ? 0.0 : set[i - kLagCycles];
    ASSERT_TRUE(cycle({set[i], 0.0}, turned, turned)) << "at " << set[i] << " m/s: " << trouble;
  }
}

TEST_F(FollowMonitorTest, FeedbackThatComesEveryFifthCycleOnlyPasses) {
  for (int i = 0; i < 1000; ++i) {
    const double turned = i % 5 == 4 ? 5.0 : 0.0;
    ASSERT_TRUE(cycle({1.0, 0.0}, turned, turned));
  }
}

TEST_F(FollowMonitorTest, AfterInvalidFeedbackItRestarts) {
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(cycle({2.8, 0.0}, 0.0, 2.8));
  wheels[0].valid = false;
  ASSERT_TRUE(cycle({2.8, 0.0}, 0.0, 2.8));
  wheels[0].valid = true;
  wheels[0].angle_rad = -1000.0;
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(cycle({2.8, 0.0}, 2.8, 2.8));
}

struct LostWheel : SafetyRig {};

TEST_F(LostWheel, StopsAnArmedVehicleAndLatches) {
  for (WheelFeedback& w : drives.wheels) w.valid = true;
  arm();
  for (int i = 0; i < 200; ++i) {
    now += kCycle;
    command(1.0);
    turn_wheels();
    cycle();
  }
  ASSERT_EQ(last.state, BridgeState::armed) << last.reason;
  freeze_wheels();
  keep_commanding(20, 1.0);
  EXPECT_FALSE(last.may_move);
  expect_reason("does not follow");
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::fault);
}

}  // namespace
}  // namespace tether::test
