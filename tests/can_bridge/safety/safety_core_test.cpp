#include "can_bridge/safety/safety_core.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/can_bridge/safety/rig.hpp"

// Following, stale and bad commands, disarming.

namespace tether::test {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

struct Following : SafetyRig {};

TEST_F(Following, StartsFromZeroWithinTheLimits) {
  arm();
  now += kCycle;
  command(1.0);
  cycle();
  EXPECT_NEAR(last.twist.v_mps, 30.0 * 0.02 * 0.02, 1e-9);  // jerk · cycle²
}

TEST_F(Following, NeverAcceleratesOrBrakesBeyondTheLimits) {
  arm();
  const TwistLimits limits = config().limits;
  double before = 0.0;
  for (const double v_mps : {2.0, 0.0, -2.0, 1.0}) {
    for (int i = 0; i < 200; ++i) {
      keep_commanding(1, v_mps);
      const double rate = (last.twist.v_mps - before) / 0.02;
      ASSERT_LE(std::abs(rate), limits.max_deceleration_mps2 + 1e-6);
      if (std::abs(last.twist.v_mps) > std::abs(before)) {
        ASSERT_LE(std::abs(rate), limits.max_acceleration_mps2 + 1e-6);
      }
      before = last.twist.v_mps;
    }
    EXPECT_NEAR(before, v_mps, 1e-9);
  }
}

TEST_F(Following, CapsASpeedBeyondTheLimitAndKeepsTheCurve) {
  arm();
  keep_commanding(400, 30.0, 5.0);
  EXPECT_NEAR(last.twist.v_mps, 3.0, 1e-9);
  EXPECT_NEAR(last.twist.omega_radps, 0.5, 1e-9);
}

TEST_F(Following, KeepsTheSpeedUntilJustBeforeTheCommandIsStale) {
  drive(1.0);
  cycle_after(kStale - kTick);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
  EXPECT_EQ(last.reason, "");
}

TEST_F(Following, RampsDownFromTheInstantTheCommandIsStale) {
  drive(1.0);
  cycle_after(kStale);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_LT(last.twist.v_mps, 1.0);
  EXPECT_GT(last.twist.v_mps, 1.0 - 1.5 * 0.02 - 1e-9);
  EXPECT_TRUE(last.may_move);
  EXPECT_EQ(last.action, Action::none);
  expect_reason("200 ms old: ramping to zero");
}

TEST_F(Following, AFreshCommandInTimeResumesWithoutArmingAgain) {
  drive(1.0);
  cycle_after(kStale);
  cycle_after(kCycle);
  const double slowest = last.twist.v_mps;
  EXPECT_LT(slowest, 1.0);
  keep_commanding(100, 1.0);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
  EXPECT_EQ(core.disarms(), 0);
}

TEST_F(Following, StaysArmedUntilJustBeforeTheDisarmTime) {
  drive(1.0);
  cycle_after(kStale);
  cycle_after(kDisarm - kStale - kTick);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_EQ(last.action, Action::none);
}

TEST_F(Following, QuickStopsAndDisarmsAtTheDisarmTime) {
  drive(1.0);
  cycle_after(kStale);
  cycle_after(kDisarm - kStale);
  EXPECT_EQ(last.state, BridgeState::stopping);
  EXPECT_EQ(last.action, Action::quick_stop);
  expect_no_motion();
  expect_reason("500 ms old");
  EXPECT_EQ(core.disarms(), 1);

  drives.standstill = true;
  cycle_after(kCycle);
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_reason("arm again with a zero command");
}

TEST_F(Following, AfterADisarmCommandsMoveNothingUntilArmedWithZero) {
  drive(1.0);
  cycle_after(kStale);
  cycle_after(kDisarm - kStale);
  drives.standstill = true;
  keep_commanding(50, 1.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_no_motion();
  request(DriveRequest::arm);  // the newest command is 1 m/s
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  arm();
}

TEST_F(Following, ACommandDelayedInTheNetworkDoesNotCountAsFresh) {
  drive(1.0);
  const Instant begin = now;
  while (now - begin < milliseconds{300}) {
    now += kCycle;
    core.on_command(now, begin + (now - begin) / 10, command_seq++, {1.0, 0.0});
    cycle();
  }
  // The newest stamp is 30 ms after the beginning: 270 ms old, though it has just arrived.
  EXPECT_LT(last.twist.v_mps, 1.0);
  expect_reason("270 ms old");
}

TEST_F(Following, AStampAheadOfOurClockAgesFromItsArrival) {
  drive(1.0);
  now += kCycle;
  core.on_command(now, now + milliseconds{50}, command_seq++, {1.0, 0.0});
  cycle_after(kStale - kTick);
  EXPECT_EQ(last.twist.v_mps, 1.0);
  cycle_after(kTick);
  EXPECT_LT(last.twist.v_mps, 1.0);
}

TEST_F(Following, AStampMoreThan50MsAheadIsRejected) {
  drive(1.0);
  now += milliseconds{190};
  core.on_command(now, now + milliseconds{50} + kTick, command_seq++, {1.0, 0.0});
  cycle_after(milliseconds{10});
  EXPECT_LT(last.twist.v_mps, 1.0) << "200 ms after the last good command";
}

TEST_F(Following, WithAShortStaleTimeAStampMayBeAheadByHalfOfIt) {
  for (const Duration ahead : {milliseconds{30} + Duration{0}, milliseconds{30} + kTick}) {
    SafetyCore::Config strict = config();
    strict.stale = milliseconds{60};
    core = SafetyCore{strict};
    core.on_command(now, now + ahead, 0, {});
    EXPECT_EQ(core.command_age(now).has_value(), ahead == milliseconds{30});
  }
}

TEST_F(Following, CommandsThatAreNotNumbersRefreshNothing) {
  for (const Twist& bad :
       {Twist{kNaN, 0.0}, Twist{0.0, kNaN}, Twist{kInf, 0.0}, Twist{0.0, -kInf}, Twist{1e9, 0.0}}) {
    SafetyCore fresh{config()};
    core = fresh;
    drives.phase = DrivePhase::standby;
    drives.standstill = true;
    cycle();
    drive(1.0);
    now += milliseconds{190};
    core.on_command(now, now, command_seq++, bad);
    cycle_after(milliseconds{10});
    EXPECT_LT(last.twist.v_mps, 1.0) << "200 ms after the last good command";
    EXPECT_GT(last.twist.v_mps, 0.9);
  }
}

TEST_F(Following, DuplicatedAndLateCommandsRefreshNothing) {
  drive(1.0);
  const Instant newest = now;
  now += milliseconds{190};
  core.on_command(now, newest, command_seq - 1, {1.0, 0.0});                     // again
  core.on_command(now, newest - milliseconds{20}, command_seq - 2, {1.0, 0.0});  // late
  core.on_command(now, now + seconds{2}, command_seq, {1.0, 0.0});               // future
  core.on_command(now, now, -1, {1.0, 0.0});                                     // no number
  cycle_after(milliseconds{10});
  EXPECT_LT(last.twist.v_mps, 1.0);
}

TEST_F(Following, ANonFiniteCommandNeverReachesTheSetpoint) {
  arm();
  now += kCycle;
  core.on_command(now, now, command_seq++, {kNaN, kNaN});
  cycle();
  EXPECT_EQ(last.twist.v_mps, 0.0);
  EXPECT_EQ(last.twist.omega_radps, 0.0);
}

struct Disarming : SafetyRig {};

TEST_F(Disarming, RampsToZeroAndKeepsThePowerOnUntilStandstill) {
  drive(1.0);
  request(DriveRequest::disarm);
  double before = 1.0;
  int cycles = 0;
  do {
    keep_commanding(1, 1.0);  // commands are ignored from now on
    ASSERT_EQ(last.state, BridgeState::stopping);
    ASSERT_EQ(last.action, Action::none) << "the wheels still turn";
    ASSERT_LE(last.twist.v_mps, before);
    ASSERT_GE(last.twist.v_mps, before - 1.5 * 0.02 - 1e-9);
    before = last.twist.v_mps;
    ASSERT_LT(++cycles, 100);
  } while (before > 0.0);
  keep_commanding(20, 1.0);
  EXPECT_EQ(last.action, Action::none) << "the setpoint is zero, the wheels still turn";

  drives.standstill = true;
  keep_commanding(1, 1.0);
  EXPECT_EQ(last.action, Action::disable);
  keep_commanding(1, 1.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_reason("disarmed by request");
  EXPECT_EQ(core.disarms(), 1);
}

TEST_F(Disarming, WheelsThatDoNotStandStillInTimeAreQuickStopped) {
  drive(1.0);
  request(DriveRequest::disarm);
  cycle();
  while (last.twist.v_mps > 0.0) keep_commanding(1, 1.0);
  now += kCycle;  // at rest: the jerk's last step is over
  cycle();
  const Instant zero = now;
  for (now = zero + kCycle; now < zero + SafetyCore::kStandstillWait; now += kCycle) {
    ASSERT_EQ(cycle().action, Action::none);
  }
  now = zero + SafetyCore::kStandstillWait;
  EXPECT_EQ(cycle().action, Action::quick_stop);
  expect_reason("still turned");
}

TEST_F(Disarming, WhileArmingSwitchesOffAgain) {
  command(0.0);
  request(DriveRequest::arm);
  cycle();
  request(DriveRequest::disarm);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  cycle_after(kCycle);
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::disarmed);
}

TEST(SafetyCoreDeathTest, ATimeOfZeroOrADisarmTimeBelowTheStaleTimeIsABug) {
  SafetyCore::Config config = SafetyRig::config();
  config.stale = Duration{0};
  EXPECT_DEATH(SafetyCore{config}, "stale");
  config = SafetyRig::config();
  config.disarm = config.stale - kTick;
  EXPECT_DEATH(SafetyCore{config}, "disarm");
}

}  // namespace
}  // namespace tether::test
