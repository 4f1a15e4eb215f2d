#include <gtest/gtest.h>

#include "tests/can_bridge/safety/rig.hpp"

// Faults of the bus and of the bridge itself: failures, gaps, the end.

namespace tether::test {
namespace {

struct Bus : SafetyRig {
  void expect_stop_and_latch(CanState state) {
    drive(1.0);
    bus = state;
    cycle_after(kCycle);
    EXPECT_EQ(last.action, Action::quick_stop) << to_string(state);
    expect_no_motion();
    bus = CanState::up;
    drives.standstill = true;
    cycle_after(kCycle);
    cycle_after(kCycle);
    EXPECT_EQ(last.state, BridgeState::fault) << to_string(state);
    expect_cannot_be_armed();
  }
};

TEST_F(Bus, OffStopsAndLatches) { expect_stop_and_latch(CanState::bus_off); }
TEST_F(Bus, StalledStopsAndLatches) { expect_stop_and_latch(CanState::stalled); }
TEST_F(Bus, DownStopsAndLatches) { expect_stop_and_latch(CanState::down); }
TEST_F(Bus, AbsentStopsAndLatches) { expect_stop_and_latch(CanState::absent); }

TEST_F(Bus, InTroubleLetsNoStopThroughSoThatNoStandstillIsBelievedForTheRampAndHalfASecond) {
  drive(1.5);  // 1 s at 1.5 m/s²
  bus = CanState::down;
  cycle_after(kCycle);
  EXPECT_EQ(last.distrust_until, now + milliseconds{1500});
  bus = CanState::up;
  drives.standstill = true;
  for (int i = 0; i < 70; ++i) ASSERT_NE(cycle_after(kCycle).action, Action::disable);
}

TEST_F(Bus, OffForLessThanACycleLatchesToo) {
  drive(1.0);
  core.on_bus_state(CanState::bus_off);
  core.on_bus_state(CanState::up);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  expect_reason("bus-off");
}

TEST_F(Bus, ErrorPassiveIsReportedAndNotLatched) {
  drive(1.0);
  bus = CanState::error_passive;
  keep_commanding(10, 1.0);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
  expect_reason("error-passive");
  bus = CanState::up;
  keep_commanding(1, 1.0);
  EXPECT_EQ(last.reason, "");
}

TEST_F(Bus, ThatWasOffIsRestartedBeforeTheResetGoesOn) {
  bus = CanState::bus_off;
  cycle();
  bus = CanState::up;  // came back, perhaps with old frames in its queues
  cycle_after(kCycle);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::restart_bus);
  EXPECT_EQ(last.state, BridgeState::fault);
  core.on_bus_restarted(true, "");
  bus = CanState::down;
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::fault);
  bus = CanState::up;
  EXPECT_EQ(cycle_after(kCycle).action, Action::reset_fault);
  EXPECT_EQ(last.state, BridgeState::disarmed);
}

TEST_F(Bus, ThatStallsIsRestartedAtOnceSoThatNoSetpointComesOutLate) {
  drive(1.0);
  bus = CanState::stalled;
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::restart_bus);
  core.on_bus_restarted(true, "");
  bus = CanState::up;
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::stopping);
  // It stalls again: only stops wait in it now.
  bus = CanState::stalled;
  drives.standstill = true;
  for (int i = 0; i < 10; ++i) EXPECT_NE(cycle_after(kCycle).action, Action::restart_bus);
  EXPECT_EQ(last.state, BridgeState::fault);
}

TEST_F(Bus, ThatStallsAfterAResetIsRestartedAgain) {
  for (int i = 0; i < 2; ++i) {
    bus = CanState::stalled;
    EXPECT_EQ(cycle_after(kCycle).action, Action::restart_bus);
    core.on_bus_restarted(true, "");
    bus = CanState::up;
    cycle_after(kCycle);
    request(DriveRequest::reset);
    EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
  }
}

TEST_F(Bus, WhoseRestartStoppedHalfWayIsRestartedByTheNextReset) {
  bus = CanState::stalled;
  EXPECT_EQ(cycle_after(kCycle).action, Action::restart_bus);
  core.on_bus_state(CanState::down);
  core.on_bus_restarted(false, "restarting can0 failed");
  bus = CanState::down;
  cycle_after(kCycle);
  expect_reason("restarting can0 failed");
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).action, Action::restart_bus);
  core.on_bus_restarted(true, "");
  bus = CanState::up;
  EXPECT_EQ(cycle_after(kCycle).action, Action::reset_fault);
  EXPECT_EQ(last.state, BridgeState::disarmed);
}

TEST_F(Bus, ThatCannotBeRestartedSaysWhatToDo) {
  bus = CanState::stalled;
  cycle();
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).action, Action::restart_bus);
  core.on_bus_restarted(false, "run: ip link set can0 down; ip link set can0 up");
  bus = CanState::up;
  for (int i = 0; i < 10; ++i) EXPECT_EQ(cycle_after(kCycle).state, BridgeState::fault);
  expect_reason("ip link set can0 up");
  // The operator does so: queues are empty now, the next reset needs no restart.
  bus = CanState::down;
  cycle_after(kCycle);
  bus = CanState::up;
  cycle_after(kCycle);
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).action, Action::reset_fault);
}

TEST_F(Bus, WhoseQueueCouldNotBeEmptiedSaysSoUntilTheReset) {
  drive(1.0);
  bus = CanState::stalled;
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).action, Action::restart_bus);
  core.on_bus_restarted(false, "restarting can0 failed: give CAP_NET_ADMIN");
  drives.phase = DrivePhase::faulted;  // one phase after another: they clear what was refused
  cycle_after(kCycle);
  drives.phase = DrivePhase::starting;
  cycle_after(kCycle);
  bus = CanState::up;
  drives.standstill = true;
  drives.phase = DrivePhase::standby;
  for (int i = 0; i < 10; ++i) cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::fault);
  expect_reason("CAN bus stalled");
  expect_reason("may still come out when the bus recovers: restarting can0 failed: give CAP");
  request(DriveRequest::reset);
  cycle_after(kCycle);
  core.on_bus_restarted(true, "");
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
  bus = CanState::bus_off;  // another matter
  EXPECT_EQ(cycle_after(kCycle).reason.find("recovers"), std::string::npos);
}

TEST_F(Bus, ThatStaysOffAfterARestartIsNotReset) {
  bus = CanState::bus_off;
  cycle();
  request(DriveRequest::reset);
  cycle_after(kCycle);
  core.on_bus_restarted(true, "");
  const Instant restarted = now;
  now = restarted + SafetyCore::kBusRestartWait - kCycle;
  cycle();
  EXPECT_EQ(last.action, Action::none);
  now = restarted + SafetyCore::kBusRestartWait;
  cycle();
  expect_reason("still bus-off");
  bus = CanState::up;  // too late for that reset
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::fault);
  EXPECT_EQ(last.action, Action::none);
}

TEST_F(Bus, AnEStopWhileTheBusRestartsHoldsTheReset) {
  bus = CanState::bus_off;
  cycle();
  request(DriveRequest::reset);
  cycle_after(kCycle);
  core.on_bus_restarted(true, "");
  request(DriveRequest::estop);
  cycle_after(kCycle);
  bus = CanState::up;
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
  EXPECT_EQ(last.action, Action::none);
}

TEST_F(Bus, ThatIsDownOrAbsentRefusesTheReset) {
  for (const CanState state : {CanState::down, CanState::absent}) {
    bus = state;
    cycle_after(kCycle);
    request(DriveRequest::reset);
    cycle_after(kCycle);
    EXPECT_EQ(last.state, BridgeState::fault);
    EXPECT_EQ(last.action, Action::none);
    expect_reason(std::string("reset refused: the CAN interface is ") + to_string(state));
  }
  bus = CanState::up;
  cycle_after(kCycle);
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
}

struct OwnLoop : SafetyRig {};

TEST_F(OwnLoop, AGapAsLongAsTheDisarmTimeIsStillNone) {
  now += kDisarm;
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
}

TEST_F(OwnLoop, ALongerGapLatchesAFaultAndStops) {
  drive(1.0);
  now += kDisarm + milliseconds{312};
  command(1.0);  // however fresh the command is after waking up
  cycle();
  EXPECT_EQ(last.action, Action::quick_stop);
  expect_no_motion();
  expect_reason("the bridge itself stood still for 812 ms");
  drives.standstill = true;
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::fault);
  expect_cannot_be_armed();
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
}

TEST_F(OwnLoop, AGapOneTickLongerThanTheDisarmTimeLatches) {
  now += kDisarm + kTick;
  EXPECT_EQ(cycle().state, BridgeState::fault);
}

struct Leaving : SafetyRig {};

TEST_F(Leaving, QuickStopsWaitsForStandstillAndPowersOff) {
  drive(1.0);
  core.leave(now);
  keep_commanding(1, 1.0);
  EXPECT_EQ(last.action, Action::quick_stop);
  expect_no_motion();
  for (int i = 0; i < 20; ++i) {
    keep_commanding(1, 1.0);
    EXPECT_EQ(last.action, Action::none);
    EXPECT_FALSE(core.has_left(now)) << "the wheels still turn";
  }
  drives_obey = false;
  drives.standstill = true;
  keep_commanding(1, 1.0);
  EXPECT_EQ(last.action, Action::disable);
  EXPECT_FALSE(core.has_left(now));
  drives.phase = DrivePhase::standby;
  keep_commanding(1, 1.0);
  EXPECT_TRUE(core.has_left(now));
}

TEST_F(Leaving, TakesOneCycleWhenNothingMoves) {
  core.leave(now);
  EXPECT_FALSE(core.has_left(now));
  cycle_after(kCycle);
  EXPECT_TRUE(core.has_left(now));
  expect_cannot_be_armed();
}

TEST_F(Leaving, DoesNotWaitForever) {
  drive(1.0);
  core.leave(now);
  const Instant began = now;
  cycle_after(kCycle);
  EXPECT_EQ(core.leave_wait(), seconds{4}) << "3 m/s at 1.5 m/s2, and 2 s";
  now = began + seconds{4} - kTick;
  EXPECT_FALSE(core.has_left(now));
  now = began + seconds{4};
  EXPECT_TRUE(core.has_left(now));
}

TEST_F(Leaving, WaitsLongerForVehiclesThatTakeLongerToStopButNotForever) {
  SafetyCore::Config slow = config();
  slow.limits.max_yaw_rate_radps = 18.0;
  EXPECT_EQ(SafetyCore{slow}.leave_wait(), seconds{8}) << "18 rad/s at 3 rad/s2, and 2 s";
  slow.limits.max_reverse_mps = 15.0;
  EXPECT_EQ(SafetyCore{slow}.leave_wait(), seconds{12}) << "15 m/s at 1.5 m/s2, and 2 s";
  slow.limits.max_speed_mps = 100.0;
  EXPECT_EQ(SafetyCore{slow}.leave_wait(), seconds{20});
}

TEST_F(Leaving, TellsOfWheelsThatStillTurnAndOfPowerThatIsStillOn) {
  drive(1.0);
  EXPECT_EQ(core.left_behind(), "") << "the bridge does not leave";
  core.leave(now);
  drives.wheels[1].speed_radps = -3.0;
  cycle_after(kCycle);
  EXPECT_NE(core.left_behind().find("the wheels turn at 1.20 m/s, power stages on"),
            std::string::npos)
      << core.left_behind();
  drives_obey = false;
  drives.phase = DrivePhase::stopping;
  drives.standstill = true;
  cycle_after(kCycle);
  EXPECT_NE(core.left_behind().find("not confirmed, power stages on"), std::string::npos)
      << core.left_behind();
  drives.phase = DrivePhase::standby;
  cycle_after(kCycle);
  EXPECT_EQ(core.left_behind(), "");
}

TEST_F(Leaving, WaitsForWheelsThatRollAfterTheDrivesFaulted) {
  drive(1.0);
  drives.phase = DrivePhase::faulted;
  cycle_after(kCycle);
  core.leave(now);
  cycle_after(kCycle);
  EXPECT_FALSE(core.has_left(now));
  EXPECT_NE(core.left_behind().find("power stages off"), std::string::npos);
  drives.standstill = true;
  cycle_after(kCycle);
  EXPECT_TRUE(core.has_left(now));
}

TEST_F(Leaving, DrivesOfWhichNothingIsKnownCountAsTurningWithPowerOn) {
  drive(1.0);
  drives.phase = DrivePhase::faulted;
  drives.feedback_fresh = drives.standstill = false;
  drives.in_doubt = true;
  cycle_after(kCycle);
  core.leave(now);
  cycle_after(kCycle);
  EXPECT_FALSE(core.has_left(now));
  EXPECT_NE(core.left_behind().find("standstill and power off are not confirmed, power stages "
                                    "perhaps on"),
            std::string::npos)
      << core.left_behind();
  drives.in_doubt = false;
  cycle_after(kCycle);
  EXPECT_TRUE(core.has_left(now));
  EXPECT_EQ(core.left_behind(), "");
}

TEST_F(Leaving, IsNotOverBeforeItBegan) {
  cycle_after(kCycle);
  EXPECT_FALSE(core.has_left(now + seconds{100}));
}

}  // namespace
}  // namespace tether::test
