#include <gtest/gtest.h>

#include "tests/can_bridge/safety/rig.hpp"

// Conditions for arming, and reasons for its refusal.

namespace tether::test {
namespace {

struct Arming : SafetyRig {
  /// ARM in this cycle is refused for a reason that contains `part`.
  void expect_refused(const std::string& part) {
    request(DriveRequest::arm);
    cycle();
    EXPECT_NE(last.state, BridgeState::arming);
    EXPECT_NE(last.action, Action::enable);
    expect_no_motion();
    expect_reason(part);
    cycle_after(kCycle);
    EXPECT_NE(last.action, Action::enable) << "a refused ARM is used up";
    expect_reason(part);
  }
};

TEST_F(Arming, IsReadyButDisarmedWithoutARequest) {
  for (int i = 0; i < 100; ++i) {
    keep_commanding(1, 0.0);
    ASSERT_EQ(last.state, BridgeState::disarmed);
    ASSERT_EQ(last.action, Action::none);
    expect_no_motion();
  }
  expect_reason("ready to be armed");
}

TEST_F(Arming, TakesARequestAndAZeroCommand) {
  command(0.0);
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::arming);
  EXPECT_EQ(last.action, Action::enable);
  expect_no_motion();
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::none) << "enable is said once";
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_TRUE(last.may_move);
  EXPECT_EQ(last.reason, "");
}

TEST_F(Arming, IsRefusedByARequestFromBeforeTheBridgeStarted) {
  for (const bool before : {true, false}) {
    struct : SafetyRig {
      void TestBody() override {}
    } rig;
    const Instant start = rig.now;
    rig.now += kCycle;
    rig.command(0.0);
    rig.core.on_request(rig.now, before ? start - kTick : start, 0, 1);
    EXPECT_EQ(rig.cycle().state == BridgeState::arming, !before);
  }
}

TEST_F(Arming, IsRefusedWithoutAnyCommand) { expect_refused("no command yet"); }

TEST_F(Arming, IsRefusedWhileTheCommandIsNotZero) {
  command(0.5, -0.25);
  expect_refused("not zero (0.500 m/s, -0.250 rad/s)");
}

TEST_F(Arming, IsRefusedWhileOnlyTheYawRateIsNotZero) {
  command(0.0, 0.001);
  expect_refused("not zero");
}

TEST_F(Arming, ToleratesACommandThatIsZeroButForRounding) {
  command(0.0009, -0.0009);
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::arming);
}

TEST_F(Arming, IsRefusedOnceTheZeroCommandIsStale) {
  command(0.0);
  now += kStale;
  expect_refused("200 ms old (limit 200 ms)");
}

TEST_F(Arming, WorksUntilJustBeforeTheZeroCommandIsStale) {
  command(0.0);
  now += kStale - kTick;
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::arming);
}

TEST_F(Arming, AZeroCommandThatWasLongInTheNetworkIsStaleOnArrival) {
  core.on_command(now, now - kStale, 0, {});
  expect_refused("200 ms old");
}

TEST_F(Arming, ARequestIsUsedUpAndDoesNotArmLater) {
  expect_refused("no command yet");
  keep_commanding(50, 0.0);
  EXPECT_EQ(last.state, BridgeState::disarmed);
}

TEST_F(Arming, TheSameRequestArrivingTwiceActsOnce) {
  const Instant pressed = now;
  core.on_request(now, pressed, 0, 1);  // no command yet: refused
  cycle();
  command(0.0);
  core.on_request(now, pressed, 0, 1);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
}

TEST_F(Arming, ARequestIsFreshForASecondAndNotLonger) {
  keep_commanding(60, 0.0);
  core.on_request(now, now - seconds{1} - kTick, 0, 1);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  core.on_request(now, now - seconds{1}, 1, 1);
  EXPECT_EQ(cycle().state, BridgeState::arming);
}

TEST_F(Arming, ARequestStampedInTheFutureIsNone) {
  command(0.0);
  core.on_request(now, now + RequestGuard::kMaxAhead + kTick, 0, 1);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  core.on_request(now, now + RequestGuard::kMaxAhead, 1, 1);
  EXPECT_EQ(cycle().state, BridgeState::arming);
}

TEST_F(Arming, IsRefusedWhileTheWheelsTurn) {
  command(0.0);
  drives.standstill = false;
  expect_refused("wheels are turning");
}

TEST_F(Arming, IsRefusedWithoutWheelFeedback) {
  command(0.0);
  drives.feedback_fresh = false;
  expect_refused("feedback");
}

TEST_F(Arming, IsRefusedInAnyPhaseButStandby) {
  drives_obey = false;
  for (const DrivePhase phase : {DrivePhase::starting, DrivePhase::refused}) {
    drives.phase = phase;
    drives.reason = "waiting for the left drive";
    now += kCycle;
    command(0.0);
    request(DriveRequest::arm);
    cycle();
    EXPECT_NE(last.action, Action::enable) << to_string(phase);
    expect_reason("waiting for the left drive; arming refused");
    cycle_after(kCycle);
    EXPECT_NE(last.action, Action::enable) << to_string(phase);
  }
}

TEST_F(Arming, IsRefusedWhileTheBusIsErrorPassive) {
  command(0.0);
  bus = CanState::error_passive;
  expect_refused("error-passive");
}

TEST_F(Arming, IsTakenBackWhenTheCommandIsNotZeroOnceTheDrivesAreOn) {
  command(0.0);
  request(DriveRequest::arm);
  cycle();
  for (int i = 0; i < 2; ++i) {
    keep_commanding(1, 0.5);
    expect_no_motion();
  }
  EXPECT_EQ(last.action, Action::quick_stop);
  EXPECT_EQ(last.state, BridgeState::stopping);
  keep_commanding(3, 0.5);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_reason("the command was not zero when the drives were on: arm again");
  EXPECT_EQ(core.disarms(), 0) << "it never was armed";
  arm();
}

TEST_F(Arming, IsTakenBackWhenTheZeroCommandIsStaleOnceTheDrivesAreOn) {
  for (const Duration age : {kStale - kTick, kStale}) {
    command(0.0);
    const Instant commanded = now;
    request(DriveRequest::arm);
    ASSERT_EQ(cycle().state, BridgeState::arming);
    cycle_after(kCycle);
    now = commanded + age;
    cycle();
    if (age < kStale) {
      EXPECT_EQ(last.state, BridgeState::armed);
      request(DriveRequest::disarm);
      for (int i = 0; i < 3; ++i) cycle_after(kCycle);
    } else {
      EXPECT_EQ(last.action, Action::quick_stop);
      expect_reason("not fresh when the drives were on");
    }
  }
}

TEST_F(Arming, DrivesThatRestartWhileTheySwitchOnLatchAFault) {
  drives_obey = false;
  command(0.0);
  request(DriveRequest::arm);
  cycle();
  drives.phase = DrivePhase::starting;
  drives.reason = "rebooted";
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::fault);
  expect_reason("left operation by themselves: rebooted");
  drives.phase = DrivePhase::enabled;
  cycle_after(kCycle);
  EXPECT_EQ(last.action, Action::quick_stop);
}

TEST_F(Arming, IsRefusedRightBehindADisarmWhileTheDrivesHaveNotYetMoved) {
  drives_obey = false;  // still in standby, though told to switch on
  command(0.0);
  request(DriveRequest::arm);
  cycle();
  now += kCycle;
  request(DriveRequest::disarm);
  request(DriveRequest::arm);
  cycle();
  EXPECT_EQ(last.state, BridgeState::stopping);
  EXPECT_EQ(last.action, Action::quick_stop);
  cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_reason("the vehicle is still stopping");
}

TEST_F(Arming, IsGivenUpWhenTheDrivesDoNotSwitchOn) {
  drives_obey = false;
  command(0.0);
  request(DriveRequest::arm);
  cycle();
  drives.phase = DrivePhase::enabling;
  drives.reason = "left drive still in SwitchedOn";
  const Instant began = now;
  for (now = began + kCycle; now < began + SafetyCore::kEnableTimeout; now += kCycle) {
    ASSERT_EQ(cycle().state, BridgeState::arming);
  }
  now = began + SafetyCore::kEnableTimeout;
  cycle();
  EXPECT_EQ(last.action, Action::quick_stop);
  EXPECT_EQ(last.state, BridgeState::stopping);
  expect_reason("left drive still in SwitchedOn");
}

}  // namespace
}  // namespace tether::test
