#include "tests/can_bridge/safety/rig.hpp"

// Who commands, and how far an old command drives.

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::kCycle;
using test::kStale;
using test::kTick;

struct Senders : test::SafetyRig {
  std::int64_t other_seq = 0;

  /// A sender that has its own numbers.
  void other_command(double v_mps) {
    now += milliseconds{1};
    core.on_command(now, now, other_seq++, {v_mps, 0.0});
  }
};

TEST_F(Senders, TwoThatTakeTurnsAreAFaultAtTheFifthTurn) {
  drive(1.0);
  for (int turn = 1; turn <= 4; ++turn) {
    other_command(2.0);
    keep_commanding(1, 1.0);
    EXPECT_EQ(last.state, BridgeState::armed) << turn;
  }
  other_command(2.0);
  EXPECT_EQ(cycle().action, Action::quick_stop);
  expect_reason("two senders take turns to command this vehicle");
  drives.standstill = true;
  for (int i = 0; i < 5; ++i) cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::fault);
  expect_cannot_be_armed();
}

TEST_F(Senders, AreAFaultOfADisarmedVehicleToo) {
  for (int turn = 0; turn < 20; ++turn) {
    now += kCycle;
    command(0.0);
    other_command(0.0);
    cycle();
  }
  EXPECT_EQ(last.state, BridgeState::fault);
}

TEST_F(Senders, SeveralProgramsAreAFaultUntilOneIsLeftAndReset) {
  drive(1.0);
  core.on_senders("AGV/CMD_VEL: 10.0.0.2:1 and 10.0.0.3:1");
  EXPECT_EQ(cycle().action, Action::quick_stop);
  expect_reason("two programs command this vehicle, on AGV/CMD_VEL: 10.0.0.2:1 and 10.0.0.3:1");
  drives.standstill = true;
  for (int i = 0; i < 5; ++i) cycle_after(kCycle);
  request(DriveRequest::reset);
  for (int i = 0; i < 5; ++i) cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::fault) << "they still do";
  core.on_senders("");
  request(DriveRequest::reset);
  cycle_after(kCycle);
  drives.phase = DrivePhase::standby;
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::disarmed);
}

TEST_F(Senders, AControllerThatIsRestartedNowAndThenIsOne) {
  drive(1.0);
  for (int start = 0; start < 10; ++start) {
    command_seq = 0;
    keep_commanding(65, 1.0);  // 1.3 s: at most four restarts in any 5 s
    EXPECT_EQ(last.state, BridgeState::armed) << start;
  }
}

TEST_F(Senders, AfterAResetOneSenderMayGoOn) {
  for (int turn = 0; turn < 5; ++turn) command(0.0), other_command(0.0);
  ASSERT_EQ(cycle().state, BridgeState::fault);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  drives.phase = DrivePhase::standby;
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  command_seq = 1000;
  arm();
}

TEST_F(Senders, AtTwoAndAHalfMetersASecondAHalfMeterOnAStaleCommandIs200Ms) {
  drive(2.5);
  cycle_after(kStale - kTick);
  EXPECT_EQ(last.twist.v_mps, 2.5);
  cycle_after(kTick);
  EXPECT_LT(last.twist.v_mps, 2.5);
}

TEST_F(Senders, FasterItRampsEarlierSoThatNoMoreThanHalfAMeterIsDriven) {
  drive(3.0);
  const Duration half_a_meter = from_seconds(0.5 / 3.0);
  cycle_after(half_a_meter - kTick);
  EXPECT_EQ(last.twist.v_mps, 3.0);
  cycle_after(kTick);
  EXPECT_LT(last.twist.v_mps, 3.0);
  expect_reason("ramping to zero");
}

/// can.operator_timeout_ms = 300.
struct HoldToRun : test::SafetyRig {
  static constexpr Duration kTimeout = milliseconds{300};
  std::int64_t alive_seq = 0;

  HoldToRun() {
    SafetyCore::Config held = config();
    held.operator_timeout = kTimeout;
    core = SafetyCore(held);
    cycle();
  }
  void hold(Duration late = {}) {
    core.on_request(now, now - late, alive_seq++, static_cast<std::int32_t>(DriveRequest::alive));
  }
  /// A cycle with a fresh command, which needs no operator.
  const Decision& commanded_cycle(Duration after, double v_mps) {
    now += after;
    command(v_mps);
    return cycle();
  }
};

TEST_F(HoldToRun, WithoutAHoldingOperatorThereIsNoArming) {
  command(0.0);
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  expect_reason("hold-to-run is released (can.operator_timeout_ms = 300): tether can hold");
}

TEST_F(HoldToRun, WhoLetsGoStopsAndDisarms) {
  hold();
  arm();
  hold();
  EXPECT_EQ(commanded_cycle(kTimeout - kTick, 1.0).state, BridgeState::armed);
  EXPECT_EQ(commanded_cycle(kTick, 1.0).state, BridgeState::stopping);
  expect_reason("hold-to-run released");
  for (int i = 0; i < 50; ++i) commanded_cycle(kCycle, 1.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  hold();
  EXPECT_EQ(commanded_cycle(kCycle, 0.0).state, BridgeState::disarmed) << "holding does not arm";
}

TEST_F(HoldToRun, AnOldAliveCountsFromItsStampAndARepeatedOneNotAtAll) {
  hold();
  arm();
  hold();
  commanded_cycle(milliseconds{250}, 0.0);
  hold(milliseconds{200});
  --alive_seq;
  hold(milliseconds{200});
  EXPECT_EQ(commanded_cycle(milliseconds{100} - kTick, 0.0).state, BridgeState::armed);
  EXPECT_EQ(commanded_cycle(kTick, 0.0).state, BridgeState::stopping);
}

TEST_F(HoldToRun, AnAliveOfAnotherClockDoesNotMakeAnArmLookOld) {
  cycle();
  now += milliseconds{20};
  hold();
  command(0.0);
  core.on_request(now, now - milliseconds{20}, request_seq++,
                  static_cast<std::int32_t>(DriveRequest::arm));
  EXPECT_EQ(cycle().state, BridgeState::arming);
}

}  // namespace
}  // namespace tether
