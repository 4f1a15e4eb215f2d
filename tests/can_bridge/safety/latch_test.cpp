#include <gtest/gtest.h>

#include "tests/can_bridge/safety/rig.hpp"

// E-stop and faults of the drives: what latches, and what resets it.

namespace tether::test {
namespace {

struct EStop : SafetyRig {};

TEST_F(EStop, StopsInTheSameCycleWithoutARamp) {
  drive(1.0);
  request(DriveRequest::estop);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  EXPECT_EQ(last.state, BridgeState::stopping);
  expect_no_motion();
  expect_reason("e-stop pressed");
  EXPECT_EQ(core.disarms(), 1);
}

TEST_F(EStop, ActsWhateverItsStampAndNumber) {
  drive(1.0);
  core.on_request(now, now - seconds{50}, 0, 3);  // numbered as the ARM was, and long ago
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
}

TEST_F(EStop, OfBeforeARestartIsPressedUntilReleasedAndReset) {
  core = SafetyCore(config());
  core.restore_estop("no proof of a clean end");
  EXPECT_EQ(cycle().state, BridgeState::estop);
  expect_reason("e-stop pressed (from the start: no proof of a clean end): release it, then reset");
  EXPECT_TRUE(last.estop_latched);
  expect_cannot_be_armed();
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
  request(DriveRequest::estop_release);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
  EXPECT_FALSE(last.estop_latched);
}

TEST_F(EStop, HoldsThePowerUntilStandstill) {
  drive(1.0);
  request(DriveRequest::estop);
  for (int i = 0; i < 50; ++i) {
    cycle_after(kCycle);
    ASSERT_NE(last.action, Action::disable) << "the wheels still turn";
    ASSERT_EQ(last.state, BridgeState::stopping);
  }
  drives_obey = false;
  drives.standstill = true;
  EXPECT_EQ(cycle_after(kCycle).action, Action::disable);
}

TEST_F(EStop, LatchesAndTheReleaseAloneMovesNothing) {
  request(DriveRequest::estop);
  EXPECT_EQ(cycle().state, BridgeState::estop);
  request(DriveRequest::estop_release);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
  expect_reason("released: reset to go on");
  expect_cannot_be_armed();
}

TEST_F(EStop, ResetIsRefusedWhilePressed) {
  request(DriveRequest::estop);
  request(DriveRequest::reset);
  EXPECT_EQ(cycle().state, BridgeState::estop);
  expect_reason("reset refused: the e-stop is pressed");
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::estop);
  request(DriveRequest::estop_release);
  cycle_after(kCycle);
  expect_reason("released: reset to go on");
}

TEST_F(EStop, ReleaseAndResetLeadToDisarmed) {
  drive(1.0);
  request(DriveRequest::estop);
  cycle_after(kCycle);
  request(DriveRequest::estop_release);
  cycle_after(kCycle);
  drives.standstill = true;
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
  keep_commanding(50, 1.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_no_motion();
  arm();
}

TEST_F(EStop, ResetIsRefusedWhileStillStopping) {
  drive(1.0);
  request(DriveRequest::estop);
  request(DriveRequest::estop_release);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  drives.standstill = true;
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
}

TEST_F(EStop, ResetIsRefusedUntilThePowerIsOffThoughTheWheelsStand) {
  drive(1.0);
  request(DriveRequest::estop);
  cycle_after(kCycle);
  request(DriveRequest::estop_release);
  drives_obey = false;
  drives.standstill = true;
  EXPECT_EQ(cycle_after(kCycle).action, Action::disable);
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::stopping);
  drives.phase = DrivePhase::standby;
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
}

TEST_F(EStop, BeatsAnArmThatArrivedJustBefore) {
  command(0.0);
  request(DriveRequest::arm);
  request(DriveRequest::estop);
  cycle();
  EXPECT_NE(last.action, Action::enable);
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::estop);
}

TEST_F(EStop, DuringEnablingSwitchesOff) {
  command(0.0);
  request(DriveRequest::arm);
  cycle();
  request(DriveRequest::estop);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
}

struct Fault : SafetyRig {
  void fail(const std::string& reason) {
    drives.phase = DrivePhase::faulted;
    drives.reason = reason;
  }
};

TEST_F(Fault, OfADriveLatchesWithItsReason) {
  drive(1.0);
  fail("right drive (node 2): fault 0x7500");
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::fault);
  expect_no_motion();
  expect_reason("right drive (node 2): fault 0x7500");
  EXPECT_EQ(core.disarms(), 1);
  // Even if the drive were to recover by itself.
  drives.phase = DrivePhase::standby;
  drives.standstill = true;
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::fault);
  expect_cannot_be_armed();
}

TEST_F(Fault, TellsWhatTheProfileLearnsLater) {
  fail("left drive: fault, error code not known yet");
  cycle();
  drives.reason = "left drive: fault 0x3210 (DC link over-voltage)";
  cycle_after(kCycle);
  expect_reason("0x3210");
}

TEST_F(Fault, ResetIsNotArm) {
  drive(1.0);
  fail("fault");
  cycle_after(kCycle);
  drives.standstill = true;
  now += kCycle;
  command(0.0);
  request(DriveRequest::reset);
  cycle();
  EXPECT_EQ(last.action, Action::reset_fault);
  EXPECT_EQ(last.state, BridgeState::starting);
  keep_commanding(20, 0.0);
  EXPECT_EQ(last.state, BridgeState::starting);
  drives.phase = DrivePhase::standby;
  keep_commanding(20, 0.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_no_motion();
  arm();
}

TEST_F(Fault, AResetIsRefusedWhileTheWheelsAreKnownToTurn) {
  drive(1.0);
  fail("left drive: fault");
  drives.turning = true;
  cycle_after(kCycle);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::none);
  EXPECT_EQ(last.state, BridgeState::fault);
  expect_reason("reset refused: the wheels are still turning");
  drives.turning = false;
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).action, Action::none);
  expect_reason("reset refused: standstill is not confirmed");
  drives.standstill = true;
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).action, Action::reset_fault);
}

TEST_F(Fault, AResetInStandbyWaitsForFeedbackOfWheelsThatMayTurn) {
  request(DriveRequest::estop);
  request(DriveRequest::estop_release);
  cycle_after(kCycle);
  drives.standstill = drives.feedback_fresh = false;
  drives.in_doubt = true;
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
  expect_reason("reset refused: wheel feedback is missing");
  drives.standstill = drives.feedback_fresh = true;
  drives.in_doubt = false;
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
}

TEST_F(Fault, AResetWithoutFeedbackIsPossibleSoThatDrivesCanRestart) {
  fail("right drive: no heartbeat");
  drives.standstill = drives.feedback_fresh = false;
  cycle_after(kCycle);
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).action, Action::reset_fault);
}

TEST_F(Fault, AnArmTogetherWithTheResetDoesNotArm) {
  fail("fault");
  cycle();
  drives_obey = false;
  drives.phase = DrivePhase::standby;  // like a profile that is ready quickly
  now += kCycle;
  command(0.0);
  request(DriveRequest::reset);
  request(DriveRequest::arm);
  cycle();
  EXPECT_EQ(last.action, Action::reset_fault);
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::disarmed);
}

TEST_F(Fault, DrivesThatRefuseStayRefusedUntilReset) {
  drives.phase = DrivePhase::refused;
  drives.reason = "left drive (node 1) has no watchdog";
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::refused);
  expect_reason("left drive (node 1) has no watchdog");
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).action, Action::reset_fault);
}

TEST_F(Fault, MissingWheelFeedbackStopsAnArmedVehicle) {
  drive(1.0);
  drives.feedback_fresh = false;
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  expect_reason("feedback is missing");
  drives.feedback_fresh = true;
  drives.standstill = true;
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::fault);
}

TEST_F(Fault, DrivesThatLeaveOperationByThemselvesLatch) {
  for (const DrivePhase phase : {DrivePhase::standby, DrivePhase::starting, DrivePhase::stopping,
                                 DrivePhase::refused, DrivePhase::enabling}) {
    core = SafetyCore{config()};
    drives.phase = DrivePhase::standby;
    drives.standstill = true;
    cycle();
    drive(1.0);
    drives.phase = phase;
    drives.reason = "rebooted";
    drives.standstill = true;
    cycle_after(kCycle);
    expect_no_motion();
    for (int i = 0; i < 5; ++i) cycle_after(kCycle);
    drives.phase = DrivePhase::standby;
    cycle_after(kCycle);
    EXPECT_EQ(last.state, BridgeState::fault) << to_string(phase);
    expect_reason("left operation by themselves");
  }
}

TEST_F(Fault, DrivesThatAreOnUnaskedAreStopped) {
  drives.phase = DrivePhase::enabled;
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  expect_reason("are on without ARM");
}

TEST_F(Fault, AQuickStopThatDoesNotEndIsReportedAndNeverSwitchesOffMovingWheels) {
  drive(1.0);
  request(DriveRequest::estop);
  cycle_after(kCycle);
  const Instant began = now;
  for (now = began + kCycle; now < began + SafetyCore::kStopTimeout; now += kCycle) {
    ASSERT_EQ(cycle().state, BridgeState::stopping);
  }
  drives.turning = true;
  now = began + SafetyCore::kStopTimeout;
  cycle();
  EXPECT_EQ(last.state, BridgeState::estop);
  expect_reason("wheels still turn");
  for (int i = 0; i < 100; ++i) ASSERT_NE(cycle_after(kCycle).action, Action::disable);
}

TEST_F(Fault, AStandstillThatIsNotConfirmedInTimeIsAStateOfItsOwnUntilResetAndTwoWitnesses) {
  drive(1.0);
  drives.in_doubt = true;
  drives.feedback_fresh = false;
  fail("right drive: no heartbeat");  // no stop is under way any more
  const Instant began = now;
  while (now < began + SafetyCore::kStopTimeout) {
    ASSERT_EQ(cycle_after(kCycle).state, BridgeState::fault);
  }
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::unconfirmed);
  expect_reason("right drive: no heartbeat; no two witnesses of each wheel say that it stands");
  request(DriveRequest::arm);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::unconfirmed);

  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::starting);
  drives.phase = DrivePhase::refused;
  drives.reason = "right drive: answers no SDO";
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::unconfirmed) << "and still latched";
  expect_reason("right drive: answers no SDO");
  drives.feedback_fresh = drives.standstill = true;
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::unconfirmed) << "until RESET";
  request(DriveRequest::reset);
  drives.phase = DrivePhase::starting;
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::starting);
  drives.phase = DrivePhase::refused;
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::refused);
}

TEST_F(Fault, AStandstillThatIsConfirmedTooLateStaysUnconfirmedUntilReset) {
  drive(1.0);
  drives.turning = true;
  fail("left drive: fault");
  for (Instant end = now + SafetyCore::kStopTimeout; now < end; cycle_after(kCycle)) {
    ASSERT_NE(last.state, BridgeState::unconfirmed);
  }
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::unconfirmed);
  expect_reason("the wheels still turn: use the hard-wired emergency stop");
  drives.turning = false;
  drives.standstill = true;
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::unconfirmed);
  expect_reason("two witnesses of each wheel say now that it stands");
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::starting);
  drives.phase = DrivePhase::standby;
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
}

TEST_F(Fault, DrivesThatStoppedAndFallSilentAreConfirmed) {
  drive(1.0);
  drives.standstill = true;
  fail("left drive: no heartbeat");
  drives.feedback_fresh = false;
  for (int i = 0; i < 500; ++i) ASSERT_EQ(cycle_after(kCycle).state, BridgeState::fault);
}

}  // namespace
}  // namespace tether::test
