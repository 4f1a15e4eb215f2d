#include <gmock/gmock.h>

#include <vector>

#include "tests/can_bridge/agilex/v2_rig.hpp"

// The profile with a chassis that reports only in part, or does not obey.

namespace tether {
namespace {

using agilex::Mode;
using ::testing::HasSubstr;
using namespace tether::test;  // NOLINT(google-build-using-namespace)

constexpr int kPatience_ms = 5000;  // longer than braking and every timeout of a step

TEST(AgilexTrust, SpeedsWithoutOdometryAreNoFeedbackAndTheOtherWayRound) {
  for (const bool speeds : {true, false}) {
    Bridge b;
    b.to_enabled();
    b.silent = true;
    for (int t = 0; t < 300; t += 20) {
      b.profile.on_frame(agilex::encode(b.state), b.now());
      if (speeds) b.profile.on_frame(agilex::encode(agilex::kMotionState, b.motion), b.now());
      if (!speeds) b.profile.on_frame(agilex::encode(b.odometry), b.now());
      b.tick();
    }
    EXPECT_FALSE(b.snapshot().feedback_fresh);
    EXPECT_FALSE(b.snapshot().standstill);
    EXPECT_EQ(b.phase(), DrivePhase::faulted);
  }
}

TEST(AgilexTrust, FeedbackIsValidFromTheFirstSpeedAndOdometryOn) {
  for (const bool speeds : {true, false}) {
    Bridge b;
    b.silent = true;
    b.tick();
    if (speeds) b.profile.on_frame(agilex::encode(agilex::kMotionState, b.motion), b.now());
    if (!speeds) b.profile.on_frame(agilex::encode(b.odometry), b.now());
    b.tick();
    EXPECT_FALSE(b.snapshot().wheels[0].valid);
    b.silent = false;
    const Instant heard = b.now();
    b.tick();
    EXPECT_TRUE(b.snapshot().wheels[0].valid);
    EXPECT_EQ(b.snapshot().wheels[0].stamp, heard);
  }
}

TEST(AgilexTrust, AChassisThatWasLostIsInDoubtUnlessItsNewestWordsSayThatItStandsInStandby) {
  Bridge never_heard;
  EXPECT_FALSE(never_heard.snapshot().in_doubt);
  for (const Mode mode : {Mode::standby, Mode::can, Mode::remote}) {
    for (const std::int16_t v_mmps : {std::int16_t{-300}, std::int16_t{0}, std::int16_t{300}}) {
      Bridge b;
      b.state.mode = mode;
      b.motion = {v_mmps, 0};
      b.tick_for(140);
      b.silent = true;
      b.tick_for(1000);
      EXPECT_EQ(b.snapshot().in_doubt, mode == Mode::can || v_mmps != 0) << v_mmps;
    }
  }
}

TEST(AgilexTrust, AChassisThatStaysInCanModeWhenStartedIsAFault) {
  Bridge b;
  b.state.mode = Mode::can;
  b.tick_for(kPatience_ms);
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_THAT(b.reason(), HasSubstr("does not leave CAN mode: another program"));
}

TEST(AgilexTrust, AChassisThatStaysInCanModeWhenStoppedIsAFault) {
  Bridge b;
  b.to_enabled();
  b.profile.stop(StopKind::quick);
  b.tick_for(kPatience_ms);
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_THAT(b.reason(), HasSubstr("does not leave CAN mode"));
}

TEST(AgilexTrust, DisableEndsTheBrakingOfAQuickStopThatIsUnderWay) {
  Bridge b;
  b.motion = {800, 0};
  b.to_enabled();
  b.profile.stop(StopKind::quick);
  EXPECT_EQ(count(b.tick_for(100), 0x421), 0);
  b.motion = {};
  b.tick_for(40);
  b.profile.distrust_standstill(b.now() + std::chrono::seconds{60});
  b.profile.stop(StopKind::disable);
  EXPECT_EQ(newest(b.tick_for(120), 0x421), agilex::mode_frame(Mode::standby));
}

TEST(AgilexTrust, AQuickStopDoesNotTakeBackADisable) {
  Bridge b;
  b.to_enabled();
  b.profile.stop(StopKind::disable);
  b.profile.stop(StopKind::quick);
  EXPECT_EQ(newest(b.tick(), 0x421), agilex::mode_frame(Mode::standby));
}

TEST(AgilexTrust, StopInStandbyAndResetWhileDrivingDoNothing) {
  Bridge b;
  b.tick();
  b.profile.stop(StopKind::quick);
  EXPECT_EQ(b.phase(), DrivePhase::standby);
  b.to_enabled();
  b.profile.reset_fault();
  EXPECT_EQ(b.phase(), DrivePhase::enabled);
}

TEST(AgilexTrust, ExtendedAndRemoteFramesAreNoReports) {
  for (const bool extended : {true, false}) {
    Bridge b;
    b.tick();
    b.state.mode = Mode::can;
    CanFrame frame = agilex::encode(b.state);
    (extended ? frame.extended : frame.remote) = true;
    b.silent = true;
    b.profile.on_frame(frame, b.now());
    b.tick();
    EXPECT_EQ(b.phase(), DrivePhase::standby);
  }
}

TEST(AgilexTrust, AJumpOfOneSideInStandbyMeansARestartToo) {
  for (const agilex::Odometry jumped : {agilex::Odometry{100000, 0}, agilex::Odometry{0, 100000}}) {
    Bridge b;
    b.tick();
    b.odometry = jumped;
    b.tick();
    EXPECT_EQ(b.phase(), DrivePhase::faulted);
    EXPECT_THAT(b.reason(), HasSubstr("it has restarted"));
  }
}

/// Both phases between standing and driving.
void enter(Bridge& b, DrivePhase phase) {
  if (phase == DrivePhase::enabling) {
    b.tick();
    b.profile.enable();
  } else {
    b.to_enabled();
    b.profile.stop(StopKind::quick);
  }
  b.tick();
  ASSERT_EQ(b.phase(), phase);
}

TEST(AgilexTrust, SilenceAndJumpsCountOnTheWayToDrivingAndBack) {
  for (const DrivePhase phase : {DrivePhase::enabling, DrivePhase::stopping}) {
    Bridge silent;
    enter(silent, phase);
    silent.silent = true;
    silent.tick_for(200);
    EXPECT_EQ(silent.phase(), DrivePhase::faulted);
    EXPECT_THAT(silent.reason(), HasSubstr("no 0x211"));
    Bridge jumped;
    enter(jumped, phase);
    jumped.odometry = {100000, 0};
    jumped.tick();
    EXPECT_THAT(jumped.reason(), HasSubstr("it has restarted"));
  }
}

TEST(AgilexTrust, TheFirstOfTwoFaultsIsReported) {
  Bridge b;
  b.tick();
  b.odometry = {100000, 0};
  b.tick();
  b.profile.on_frame(agilex::encode(agilex::kMotionCommand, agilex::Motion{}), b.now());
  b.tick();
  EXPECT_THAT(b.reason(), HasSubstr("it has restarted"));
}

TEST(AgilexTrust, TheStatuswordIsConditionAndMode) {
  Bridge b;
  b.state.mode = Mode::remote;
  b.state.condition = agilex::Condition::exception;
  b.tick();
  EXPECT_EQ(b.snapshot().wheels[0].statusword,
            static_cast<std::uint32_t>(agilex::Condition::exception) << 8 |
                static_cast<std::uint32_t>(Mode::remote));
  EXPECT_EQ(b.snapshot().wheels[0].state, "Exception");
}

/// Rolls at 1 m/s, at 5 m and 4 m, and is silent for 2 s.
struct Gone : Bridge {
  Gone() {
    odometry = {5000, 4000};
    motion = {1000, 0};
    tick();
    silent = true;
    tick_for(2000);
    silent = false;
    motion = {};
  }
  double way_m(std::size_t wheel) const { return snapshot().wheels[wheel].angle_rad * kRadius_m; }
  double uncounted_m() const { return snapshot().wheels[0].uncounted_rad * kRadius_m; }
};

TEST(AgilexTrust, WhatTheChassisCountedDuringASilenceIsTakenUp) {
  Gone b;
  b.odometry = {6000, 5100};
  b.tick();
  EXPECT_NEAR(b.way_m(0), 1.0, 1e-9);
  EXPECT_NEAR(b.way_m(1), 1.1, 1e-9);
  EXPECT_EQ(b.uncounted_m(), 0.0);
}

TEST(AgilexTrust, ACountNearZeroAfterASilenceMayBeThatOfARestartedChassis) {
  for (const auto& [left_mm, counts] : {std::pair{1000, true}, std::pair{999, false}}) {
    Gone b;
    b.odometry = {left_mm, 0};
    b.tick();
    EXPECT_NEAR(b.way_m(0), counts ? -4.0 : 0.0, 1e-9) << left_mm;
    // 2.02 s at 1 m/s, and at the 0.02 m/s that still count as standing.
    EXPECT_NEAR(b.uncounted_m(), counts ? 0.0 : 2.02 * 1.02, 1e-9) << left_mm;
  }
}

TEST(AgilexTrust, MoreThanTheWheelsCanTurnDuringASilenceIsNotBelieved) {
  // A metre, and twice 1 m/s for 2.02 s.
  for (const auto& [moved_mm, counts] : {std::pair{5040, true}, std::pair{5041, false}}) {
    Gone b;
    b.odometry = {5000 + moved_mm, 4000};
    b.tick();
    EXPECT_NEAR(b.way_m(0), counts ? 5.04 : 0.0, 1e-9);
    EXPECT_EQ(b.uncounted_m() > 0.0, !counts);
  }
}

TEST(AgilexTrust, AfterASilenceTheWayMayBeAnything) {
  Bridge b;
  b.tick();
  b.profile.on_frame(agilex::encode(agilex::Odometry{100000, 0}),
                     b.now() + std::chrono::seconds{1});
  EXPECT_EQ(b.phase(), DrivePhase::standby);
}

}  // namespace
}  // namespace tether
