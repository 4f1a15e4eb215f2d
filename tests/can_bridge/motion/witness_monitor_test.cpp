#include "can_bridge/safety/witness_monitor.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/can_bridge/safety/rig.hpp"

namespace tether {
namespace {

using test::SafetyRig;
using ::testing::HasSubstr;

constexpr double kTrack_m = 1.2, kRadius_m = 0.4;

/// A drive straight on; the left wheel reports `speed` and counts `position` times its true way.
struct Drive {
  double speed = 1.0;
  double position = 1.0;
  double lag_s = 0.0;  // lag of the reported speed
  bool proven = true;
  double turns = 1.0;  // ratio to the setpoint

  std::string reason{};
  double noticed_m = -1.0;  // true way until then

  Drive& run(double v_mps = 1.0, double way_m = 20.0) {
    WitnessMonitor monitor(kTrack_m, kRadius_m);
    std::array<WheelFeedback, 2> wheels;
    for (WheelFeedback& wheel : wheels) wheel.valid = true;
    constexpr double kCycle_s = 0.02, kAcceleration_mps2 = 1.0;
    double true_m = 0.0, v = 0.0, shown = 0.0;
    bool second = !proven;
    for (Instant now = kStart; std::abs(true_m) < way_m; now += test::kCycle) {
      reason = monitor.update(now, {v, 0.0}, wheels);
      if (!reason.empty()) {
        noticed_m = true_m;
        return *this;
      }
      v = std::min(v + kAcceleration_mps2 * kCycle_s, v_mps);
      true_m += v * turns * kCycle_s;
      // Deviations begin once the scales have been proven, or from the beginning.
      const bool deviates = second || true_m > 3.0;
      shown += (v * turns - shown) * (lag_s > 0.0 ? kCycle_s / (lag_s + kCycle_s) : 1.0);
      wheels[0].speed_radps = shown * (deviates ? speed : 1.0) / kRadius_m;
      wheels[0].angle_rad += v * turns * kCycle_s * (deviates ? position : 1.0) / kRadius_m;
      wheels[1].speed_radps = v / kRadius_m;
      wheels[1].angle_rad += v * kCycle_s / kRadius_m;
    }
    return *this;
  }
  double late_m() const { return noticed_m - (proven ? 3.0 : 0.0); }
};

TEST(WitnessMonitor, WitnessesThatAgreePass) {
  EXPECT_EQ(Drive{}.run().reason, "");
  EXPECT_EQ(Drive{}.run(3.0, 60.0).reason, "");
  EXPECT_EQ((Drive{.lag_s = 0.05}.run(3.0, 60.0).reason), "") << "a speed that lags";
  EXPECT_EQ((Drive{.speed = 1.08}.run(1.0, 60.0).reason), "") << "8 % too much";
}

struct Case {
  const char* name;
  double speed, position, within_m;
  const char* reason;
};
class Deviation : public ::testing::TestWithParam<Case> {};

TEST_P(Deviation, IsNoticedAndNamed) {
  const auto& [name, speed, position, within_m, reason] = GetParam();
  const Drive drive = Drive{.speed = speed, .position = position}.run();
  fmt::print("measured: {}: noticed after {:.2f} m\n", name, drive.late_m());
  EXPECT_THAT(drive.reason, HasSubstr("the left wheel: "));
  EXPECT_THAT(drive.reason, HasSubstr(reason));
  EXPECT_LE(drive.late_m(), within_m);
}

TEST_P(Deviation, OfAFreshStartUpIsNoticedInTheFirstWayAndNamed) {
  const auto& [name, speed, position, within_m, reason] = GetParam();
  const Drive drive = Drive{.speed = speed, .position = position, .proven = false}.run();
  EXPECT_THAT(drive.reason, HasSubstr(reason));
  EXPECT_LE(drive.noticed_m, std::max(within_m, 0.25));
}

INSTANTIATE_TEST_SUITE_P(
    WitnessMonitor, Deviation,
    ::testing::Values(
        Case{"SpeedReadsZero", 0.0, 1.0, 0.25, "stays at zero while its position counts"},
        Case{"SpeedReversed", -1.0, 1.0, 0.15, "sign of its reported speed is reversed"},
        Case{"SpeedThreeTimes", 3.0, 1.0, 0.20, "actual_velocity_per_rps is wrong"},
        Case{"SpeedATwentiethMore", 1.25, 1.0, 2.0, "actual_velocity_per_rps is wrong"},
        Case{"PositionFrozen", 1.0, 0.0, 0.25, "encoder frozen"},
        Case{"PositionReversed", 1.0, -1.0, 0.15, "sign of its position is reversed"},
        Case{"PositionHalf", 1.0, 0.5, 0.60, "counts_per_revolution is wrong"}),
    [](const auto& info) { return info.param.name; });

TEST(WitnessMonitor, TheFirstFifthOfAMetreAfterAStartUpMustAgree) {
  const Drive wrong = Drive{.speed = 1.5, .proven = false}.run();
  EXPECT_NE(wrong.reason, "");
  EXPECT_LE(wrong.noticed_m, 0.21);
  const Drive right = Drive{.speed = 1.05, .proven = false}.run(1.0, 5.0);
  EXPECT_EQ(right.reason, "");
}

TEST(WitnessMonitor, InTheFirstFifthOfAMetreBothMustAgreeWithTheSetpointToo) {
  for (const double turns : {1.6, 2.0, -1.0}) {
    const Drive wrong = Drive{.proven = false, .turns = turns}.run(0.5);
    EXPECT_THAT(wrong.reason, HasSubstr("agree on")) << turns;
    EXPECT_LE(std::abs(wrong.noticed_m), 0.23) << turns;
  }
  for (const double turns : {0.9, 1.2}) {
    EXPECT_EQ((Drive{.proven = false, .turns = turns}.run(0.5, 5.0).reason), "") << turns;
  }
  for (const double turns : {0.0, 0.2}) {
    EXPECT_THAT((Drive{.proven = false, .turns = turns}.run(0.3, 1.0).reason),
                HasSubstr("agree that it hardly turns: blocked"));
  }
}

TEST(WitnessMonitor, NamesWhatAnotherMonitorHasNoticedFromHalfOfItsLimitOn) {
  WitnessMonitor monitor(kTrack_m, kRadius_m);
  std::array<WheelFeedback, 2> wheels;
  for (WheelFeedback& wheel : wheels) wheel.valid = true;
  double way_m = 0.0;
  for (Instant now = kStart; way_m < 0.066; now += test::kCycle) {
    ASSERT_EQ(monitor.update(now, {0.5, 0.0}, wheels), "");
    // 0.01 m a cycle, and the difference of speed and position is twice that.
    EXPECT_EQ(monitor.suspicion().empty(), way_m < 0.0535) << way_m;
    way_m += 0.01;
    wheels[0].speed_radps = wheels[1].speed_radps = 0.5 / kRadius_m;
    wheels[0].angle_rad += 0.01 / kRadius_m;
    wheels[1].angle_rad -= 0.01 / kRadius_m;
  }
  EXPECT_THAT(monitor.suspicion(), HasSubstr("the right wheel: the sign of its position"));
}

TEST(WitnessMonitor, WithoutASetpointItSaysWhatIsKnown) {
  WitnessMonitor monitor(kTrack_m, kRadius_m);
  std::array<WheelFeedback, 2> wheels;
  for (WheelFeedback& wheel : wheels) wheel.valid = true;
  std::string reason;
  for (int i = 0; i < 100 && reason.empty(); ++i) {
    reason = monitor.update(kStart + i * test::kCycle, {}, wheels);
    wheels[1].angle_rad += 0.05;
  }
  EXPECT_THAT(reason,
              HasSubstr("the right wheel: speed (0x606C) and position (0x6064) contradict"));
}

TEST(WitnessMonitor, FeedbackThatIsNotValidStartsItAgain) {
  WitnessMonitor monitor(kTrack_m, kRadius_m);
  std::array<WheelFeedback, 2> wheels;
  for (WheelFeedback& wheel : wheels) wheel.valid = true;
  monitor.update(kStart, {}, wheels);
  wheels[0].valid = false;
  monitor.update(kStart + test::kCycle, {}, wheels);
  wheels[0].valid = true;
  wheels[0].angle_rad = 100.0;
  EXPECT_EQ(monitor.update(kStart + 2 * test::kCycle, {}, wheels), "");
}

TEST_F(SafetyRig, AWheelThatDoesNotFollowBecauseAWitnessIsWrongIsReportedAsThat) {
  for (WheelFeedback& wheel : drives.wheels) wheel.valid = true;
  arm();
  double way_m = 0.0;
  for (int i = 0; i < 200 && last.state == BridgeState::armed; ++i) {
    turn_wheels();
    const double step_m = last.twist.v_mps * to_seconds(test::kCycle);
    way_m +=
        step_m;  // reversed after the start-up's proof, so that the other monitor notices first
    if (way_m > 0.5) drives.wheels[1].angle_rad -= 2.0 * step_m / 0.4;
    now += test::kCycle;
    command(2.0);
    cycle();
  }
  expect_reason("the right wheel: the sign of its position is reversed");
}

TEST_F(SafetyRig, WitnessesThatContradictEachOtherAreAFaultAfterWhichNoStandstillIsBelieved) {
  for (WheelFeedback& wheel : drives.wheels) wheel.valid = true;
  arm();
  for (int i = 0; i < 200 && last.state == BridgeState::armed; ++i) {
    for (WheelFeedback& wheel : drives.wheels) wheel.angle_rad += last.twist.v_mps * 0.02 / 0.4;
    now += test::kCycle;
    command(1.0);
    cycle();
  }
  EXPECT_EQ(last.state, BridgeState::stopping);
  expect_reason("stays at zero while its position counts");
  EXPECT_TRUE(last.distrust_until);
}

}  // namespace
}  // namespace tether
