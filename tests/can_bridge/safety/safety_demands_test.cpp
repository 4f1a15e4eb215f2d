#include <gtest/gtest.h>

#include "tests/can_bridge/safety/rig.hpp"

// Demands of safety inputs, and the safety core's reactions.

namespace tether::test {
namespace {

struct Demands : SafetyRig {
  SafetyDemands demands;

  const Decision& demand() {
    core.on_safety_inputs(demands);
    now += kCycle;
    command(1.0);
    return cycle();
  }
  /// Goes on commanding `v_mps` until the setpoint rests.
  void settle(double v_mps, double omega_radps = 0.0) { keep_commanding(150, v_mps, omega_radps); }
};

struct ProtectiveStop : Demands {
  ProtectiveStop() { demands.stop = "safety input field demands a stop"; }
};

TEST_F(ProtectiveStop, StopsInTheSameCycleAndDisarmsForGood) {
  drive(1.0);
  EXPECT_EQ(demand().action, Action::quick_stop);
  EXPECT_EQ(last.state, BridgeState::stopping);
  expect_no_motion();
  expect_reason("safety input field demands a stop");
  EXPECT_EQ(core.disarms(), 1);
  drives.standstill = true;
  keep_commanding(5, 1.0);
  core.on_safety_inputs({});
  keep_commanding(100, 1.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_reason("arm again when it is clear");
  expect_no_motion();
  arm();
}

TEST_F(ProtectiveStop, RefusesToArmWhileItIsDemanded) {
  core.on_safety_inputs(demands);
  EXPECT_EQ(cycle().reason, "safety input field demands a stop");
  expect_cannot_be_armed();
  expect_reason("arming refused: safety input field demands a stop");
  demands.may_resume = demands.ramp = true;
  core.on_safety_inputs(demands);
  expect_cannot_be_armed();
  core.on_safety_inputs({});
  arm();
}

TEST_F(ProtectiveStop, EndsArmingThatIsUnderWay) {
  for (const bool gentle : {false, true}) {
    command(0.0);
    request(DriveRequest::arm);
    ASSERT_EQ(cycle().state, BridgeState::arming);
    demands.ramp = demands.may_resume = gentle;
    core.on_safety_inputs(demands);
    EXPECT_EQ(cycle_after(kCycle).action, Action::quick_stop);
    core.on_safety_inputs({});
    keep_commanding(5, 0.0);
    ASSERT_EQ(last.state, BridgeState::disarmed);
  }
}

TEST_F(ProtectiveStop, ByRampEndsDisarmedToo) {
  drive(1.0);
  demands.ramp = true;
  demand();
  EXPECT_EQ(last.action, Action::none);
  EXPECT_EQ(last.state, BridgeState::stopping);
  EXPECT_GT(last.twist.v_mps, 0.9);
  drives.standstill = true;
  settle(1.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_reason("safety input field demands a stop");
  EXPECT_EQ(core.disarms(), 1);
}

TEST_F(ProtectiveStop, ThatBecomesUrgentOnTheRampIsAQuickStop) {
  drive(1.0);
  demands.ramp = true;
  demand();
  demands.ramp = false;
  EXPECT_EQ(demand().action, Action::quick_stop);
}

TEST_F(ProtectiveStop, ThatTheDrivesDoNotObeyIsAFaultThoughItIsStillDemanded) {
  drive(1.0);
  drives.turning = true;
  demand();
  for (int i = 0; i < 260; ++i) demand();
  EXPECT_EQ(last.state, BridgeState::unconfirmed);
  expect_reason("the wheels still turn");
  EXPECT_EQ(last.reason.find("power is off"), std::string::npos)
      << "it must not be off: " << last.reason;
}

TEST_F(ProtectiveStop, ThatMayRestartRampsStaysArmedAndGoesOn) {
  drive(1.0);
  demands.ramp = demands.may_resume = true;
  demand();
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_LT(last.twist.v_mps, 1.0);
  expect_reason("safety input field demands a stop: stands until then");
  settle(1.0);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_EQ(last.twist.v_mps, 0.0);
  core.on_safety_inputs({});
  settle(1.0);
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
  EXPECT_EQ(last.reason, "");
  EXPECT_EQ(core.disarms(), 0);
}

TEST_F(ProtectiveStop, WhileItMayRestartOldCommandsStillDisarm) {
  drive(1.0);
  demands.ramp = demands.may_resume = true;
  demand();
  for (int i = 0; i < 25; ++i) cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::stopping);
}

struct SpeedLimit : Demands {
  SpeedLimit() {
    demands.speed_limit_mps = 0.3;
    demands.speed_limit_by = "safety input warning";
  }
};

TEST_F(SpeedLimit, SlowsDownWithinTheLimitsAndFollowsAgainAfterwards) {
  drive(1.0);
  demand();
  EXPECT_GT(last.twist.v_mps, 0.9);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_EQ(last.reason, "limited to 0.3 m/s by safety input warning");
  settle(1.0);
  EXPECT_NEAR(last.twist.v_mps, 0.3, 1e-9);
  settle(-1.0);
  EXPECT_NEAR(last.twist.v_mps, -0.3, 1e-9);
  core.on_safety_inputs({});
  settle(1.0);
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
}

TEST_F(SpeedLimit, HoldsForTheFasterRimAndKeepsTheCurve) {
  drive(1.0);
  demand();
  settle(0.6, 1.0);  // rims at 0 and 1.2 m/s
  EXPECT_NEAR(last.twist.v_mps, 0.15, 1e-9);
  EXPECT_NEAR(last.twist.omega_radps, 0.25, 1e-9);
  settle(0.6, -1.0);
  EXPECT_NEAR(last.twist.v_mps, 0.15, 1e-9);
}

TEST_F(SpeedLimit, LeavesASlowerCommandAlone) {
  drive(1.0);
  demand();
  settle(0.2);
  EXPECT_NEAR(last.twist.v_mps, 0.2, 1e-9);
}

struct EStopContact : Demands {
  EStopContact() { demands.estop = "safety input chain: e-stop pressed"; }
};

TEST_F(EStopContact, ActsAsEStopAndLatchesUntilItIsReleasedAndReset) {
  drive(1.0);
  EXPECT_EQ(demand().action, Action::quick_stop);
  drives.standstill = true;
  keep_commanding(5, 0.0);
  EXPECT_EQ(last.state, BridgeState::estop);
  expect_reason("safety input chain: e-stop pressed: release it, then reset");
  request(DriveRequest::estop_release);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::estop);
  expect_reason("reset refused: the e-stop is pressed");
  core.on_safety_inputs({});
  keep_commanding(5, 0.0);
  EXPECT_EQ(last.state, BridgeState::estop);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
}

TEST_F(Demands, NoArmingIsReportedAndRefusesToArm) {
  demands.no_arming = "not commissioned";
  core.on_safety_inputs(demands);
  EXPECT_EQ(cycle().reason, "not commissioned");
  expect_cannot_be_armed();
  EXPECT_EQ(last.reason, "arming refused: not commissioned");
  core.on_safety_inputs({});
  arm();
  core.on_safety_inputs(demands);
  keep_commanding(50, 1.0);
  EXPECT_EQ(last.state, BridgeState::armed);
}

struct EStopThatIsNotRemembered : Demands {
  EStopThatIsNotRemembered() { demands.no_release = "the e-stop is not remembered"; }
};

TEST_F(EStopThatIsNotRemembered, IsReportedWhileTheVehicleDrivesOn) {
  drive(1.0);
  demand();
  keep_commanding(50, 1.0);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_EQ(last.reason, "the e-stop is not remembered");
  EXPECT_GT(last.twist.v_mps, 0.5);
}

TEST_F(EStopThatIsNotRemembered, RefusesToArm) {
  core.on_safety_inputs(demands);
  EXPECT_EQ(cycle().reason, "ready to be armed; the e-stop is not remembered");
  expect_cannot_be_armed();
  EXPECT_EQ(last.reason, "arming refused: the e-stop is not remembered");
  core.on_safety_inputs({});
  arm();
}

TEST_F(EStopThatIsNotRemembered, CannotBeReleased) {
  core.on_safety_inputs(demands);
  request(DriveRequest::estop);
  cycle_after(kCycle);
  request(DriveRequest::estop_release);
  EXPECT_EQ(
      cycle_after(kCycle).reason,
      "e-stop pressed: release it, then reset; release refused; the e-stop is not remembered");
  request(DriveRequest::reset);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::estop);
  core.on_safety_inputs({});
  request(DriveRequest::estop_release);
  request(DriveRequest::reset);
  cycle_after(kCycle);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::disarmed);
}

}  // namespace
}  // namespace tether::test
