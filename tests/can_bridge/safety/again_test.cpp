#include <gtest/gtest.h>

#include "tests/can_bridge/safety/rig.hpp"

// The second time round: nothing of an earlier drive is left when the vehicle is armed again.

namespace tether::test {
namespace {

struct SecondTime : SafetyRig {
  /// Wheels that follow their setpoints.
  void drive_with_wheels(double v_mps, int cycles) {
    for (int i = 0; i < cycles; ++i) {
      now += kCycle;
      command(v_mps);
      turn_wheels();
      cycle();
    }
  }
  void fault_and_reset() {
    drives.phase = DrivePhase::faulted;
    drives.reason = "right drive: fault";
    cycle_after(kCycle);
    drives.standstill = true;
    request(DriveRequest::reset);
    cycle_after(kCycle);
    drives.phase = DrivePhase::standby;
    cycle_after(kCycle);
    ASSERT_EQ(last.state, BridgeState::disarmed) << last.reason;
  }
  /// From driving to standby, in order.
  void disarm() {
    request(DriveRequest::disarm);
    do cycle_after(kCycle);
    while (last.twist.v_mps > 0.0);
    drives.standstill = true;
    for (int i = 0; i < 5; ++i) cycle_after(kCycle);
    ASSERT_EQ(last.state, BridgeState::disarmed) << last.reason;
  }
};

TEST_F(SecondTime, AfterAFaultTheFirstSetpointIsZeroAndNotTheOldSpeed) {
  drive(1.0);
  fault_and_reset();
  arm();
  EXPECT_EQ(last.twist.v_mps, 0.0);
  EXPECT_EQ(last.twist.omega_radps, 0.0);
  keep_commanding(1, 1.0);
  EXPECT_NEAR(last.twist.v_mps, 30.0 * 0.02 * 0.02, 1e-9);  // jerk · cycle²
}

TEST_F(SecondTime, AfterADisarmAnEStopStillQuickStops) {
  drive(1.0);
  disarm();
  drive(1.0);
  request(DriveRequest::estop);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  expect_no_motion();
  drives_obey = false;
  drives.standstill = true;
  EXPECT_EQ(cycle_after(kCycle).action, Action::disable);
}

TEST_F(SecondTime, TheWheelsHaveTheirWholeTimeToStandStillAfterTheRampAgain) {
  drive(1.0);
  disarm();
  now += SafetyCore::kStandstillWait;
  core.on_command(now, now, command_seq++, {});
  cycle_after(Duration{0});
  ASSERT_EQ(last.state, BridgeState::fault) << "it stood still itself: reset";
  request(DriveRequest::reset);
  cycle_after(kCycle);
  drive(1.0);
  request(DriveRequest::disarm);
  do cycle_after(kCycle);
  while (last.twist.v_mps > 0.0);
  for (int i = 0; i < 50; ++i) ASSERT_EQ(cycle_after(kCycle).action, Action::none) << i;
}

TEST_F(SecondTime, AWheelThatDidNotFollowBeforeIsJudgedAgain) {
  for (WheelFeedback& w : drives.wheels) w.valid = true;
  arm();
  drive_with_wheels(1.0, 200);
  freeze_wheels();
  keep_commanding(20, 1.0);
  ASSERT_FALSE(last.may_move);
  for (int i = 0; i < 100; ++i) cycle_after(kCycle);
  ASSERT_EQ(last.state, BridgeState::fault) << last.reason;
  for (WheelFeedback& w : drives.wheels) w.angle_rad += 100.0;  // pushed
  request(DriveRequest::reset);
  ASSERT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
  arm();
  drive_with_wheels(1.0, 200);
  EXPECT_EQ(last.state, BridgeState::armed) << last.reason;
}

struct LyingFeedback : SafetyRig {
  static constexpr double kSpeed_mps = 2.4;
  /// 2.4 m/s at 1.5 m/s² and the margin.
  static constexpr Duration kDistrust = milliseconds{1600} + SafetyCore::kDistrustMargin;

  /// Both encoders freeze at full speed: they show standstill from then on.
  Instant freeze() {
    for (WheelFeedback& w : drives.wheels) w.valid = true;
    arm();
    for (int i = 0; i < 300; ++i) {
      now += kCycle;
      command(kSpeed_mps);
      turn_wheels();
      cycle();
    }
    drives.standstill = true;
    freeze_wheels();
    for (int i = 0; i < 20 && last.action == Action::none; ++i) keep_commanding(1, kSpeed_mps);
    EXPECT_EQ(last.action, Action::quick_stop) << last.reason;
    return now;
  }
};

TEST_F(LyingFeedback, StandstillIsNotBelievedUntilTheVehicleCanStand) {
  const Instant stopped = freeze();
  ASSERT_TRUE(last.distrust_until);
  EXPECT_EQ(*last.distrust_until, stopped + kDistrust);
  drives_obey = false;
  drives.phase = DrivePhase::stopping;
  for (now = stopped + kCycle; now < stopped + kDistrust; now += kCycle) {
    ASSERT_EQ(cycle().action, Action::none) << to_seconds(now - stopped);
  }
  now = stopped + kDistrust;
  EXPECT_EQ(cycle().action, Action::disable);
}

TEST_F(LyingFeedback, ATurnThatTakesLongerToEndCountsToo) {
  drive(0.0, 1.8);
  drives.feedback_fresh = false;
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  ASSERT_TRUE(last.distrust_until);
  EXPECT_EQ(*last.distrust_until, now + milliseconds{600} + SafetyCore::kDistrustMargin);
}

TEST_F(LyingFeedback, IsNotBelievedByAResetEitherAlsoWhenADriveFaultsMeanwhile) {
  const Instant stopped = freeze();
  drives.phase = DrivePhase::faulted;
  drives.reason = "right drive: fault";
  drives.in_doubt = true;
  cycle_after(kCycle);
  for (now += kCycle; now < stopped + kDistrust; now += kCycle) {
    drives.in_doubt = !drives.in_doubt;  // reports of drives on their power do not matter yet
    request(DriveRequest::reset);
    ASSERT_NE(cycle().action, Action::reset_fault) << to_seconds(now - stopped);
    expect_reason("so its standstill is not believed for another");
    EXPECT_EQ(last.distrust_until, stopped + kDistrust) << "the profile is notified, too";
  }
  now = stopped + kDistrust;
  drives.in_doubt = true;
  request(DriveRequest::reset);
  EXPECT_NE(cycle().action, Action::reset_fault);
  expect_reason("its drive does not show power off");
  drives.in_doubt = false;
  now += kCycle;
  request(DriveRequest::reset);
  EXPECT_EQ(cycle().action, Action::reset_fault);
}

TEST_F(LyingFeedback, OfADriveThatIsGoneCanBeResetAfterItsTime) {
  const Instant stopped = freeze();
  drives.phase = DrivePhase::faulted;
  drives.in_doubt = true;
  drives.feedback_fresh = drives.standstill = false;
  cycle_after(kCycle);
  now = stopped + kDistrust;
  request(DriveRequest::reset);
  EXPECT_EQ(cycle().action, Action::reset_fault);
}

TEST_F(LyingFeedback, IsOfThePastOnceTheVehicleIsArmedAgain) {
  const Instant stopped = freeze();
  drives_obey = false;
  drives.phase = DrivePhase::stopping;
  for (now = stopped + kCycle; now < stopped + kDistrust; now += kCycle) cycle();
  now = stopped + kDistrust;
  cycle();
  drives_obey = true;
  drives.phase = DrivePhase::standby;
  cycle_after(kCycle);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  for (WheelFeedback& w : drives.wheels) w.valid = false;  // the monitor has nothing to say
  drive(1.0);
  request(DriveRequest::estop);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  EXPECT_FALSE(last.distrust_until);
  drives_obey = false;
  drives.standstill = true;
  EXPECT_EQ(cycle_after(kCycle).action, Action::disable);
}

}  // namespace
}  // namespace tether::test
