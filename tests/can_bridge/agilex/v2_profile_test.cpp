#include "can_bridge/agilex/v2_profile.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/can_bridge/agilex/v2_rig.hpp"

namespace tether {
namespace {

using agilex::Condition;
using agilex::Mode;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using namespace tether::test;  // NOLINT(google-build-using-namespace)

const CanFrame kZero = agilex::encode(0x111, agilex::Motion{});

TEST(AgilexProfile, WaitsForAllThreeReportsAndSendsNothingMeanwhile) {
  AgilexV2Profile profile(agilex_chassis(), kRadius_m, kTrack_m);
  std::vector<CanFrame> out;
  profile.start(kStart);
  profile.on_frame(agilex::encode(agilex::SystemState{}), kStart);
  profile.on_frame(agilex::encode(agilex::kMotionState, agilex::Motion{}), kStart);
  profile.tick(kStart, out);
  EXPECT_EQ(profile.snapshot(kStart).phase, DrivePhase::starting);
  profile.on_frame(agilex::encode(agilex::Odometry{}), kStart);
  profile.tick(kStart, out);
  EXPECT_EQ(profile.snapshot(kStart).phase, DrivePhase::standby);
  EXPECT_THAT(out, IsEmpty());
}

TEST(AgilexProfile, AMissingChassisIsRefusedAfterTheBootTimeout) {
  Bridge b;
  b.silent = true;
  b.tick_for(2000);
  EXPECT_EQ(b.phase(), DrivePhase::starting);
  EXPECT_THAT(b.tick(), IsEmpty());
  EXPECT_EQ(b.phase(), DrivePhase::refused);
  EXPECT_EQ(b.reason(),
            "chassis: no 0x211, 0x221, 0x311: check its supply, the CAN plug, termination and the "
            "bit rate (500 kbit/s)");
  b.silent = false;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::refused) << "leaves only by reset";
  b.profile.reset_fault();
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::standby);
}

TEST(AgilexProfile, IsEnabledOnlyWhenTheChassisSaysSo) {
  Bridge b;
  b.tick();
  b.profile.enable();
  const auto out = b.tick_for(960);
  EXPECT_EQ(b.phase(), DrivePhase::enabling);
  EXPECT_EQ(count(out, 0x111), 48);
  EXPECT_EQ(newest(out, 0x111), kZero);
  EXPECT_EQ(count(out, 0x421), 10);
  EXPECT_EQ(newest(out, 0x421), agilex::mode_frame(Mode::can));
  b.state.mode = Mode::can;
  EXPECT_THAT(b.tick(), ::testing::ElementsAre(kZero));
  EXPECT_EQ(b.phase(), DrivePhase::enabled);
}

TEST(AgilexProfile, AChassisThatStaysInRemoteControlIsAFault) {
  Bridge b;
  b.state.mode = Mode::remote;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::standby);
  b.profile.enable();
  b.tick_for(1000);
  EXPECT_EQ(b.phase(), DrivePhase::enabling);
  EXPECT_THAT(b.tick(), IsEmpty());
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_THAT(b.reason(), HasSubstr("stays in RemoteControl for 1000 ms"));
}

TEST(AgilexProfile, CommandsLeaveOnlyWhileEnabled) {
  Bridge b;
  b.profile.set_command({1.0, 0.0});
  b.tick();
  b.profile.set_command({1.0, 0.0});
  EXPECT_THAT(b.tick(), IsEmpty());
  b.profile.enable();
  b.profile.set_command({1.0, 0.0});
  EXPECT_EQ(newest(b.tick(), 0x111), kZero);
  b.state.mode = Mode::can;
  EXPECT_EQ(newest(b.tick(), 0x111), kZero);
  b.profile.set_command({1.0, -0.25});
  EXPECT_THAT(b.tick(), ::testing::ElementsAre(agilex::encode(0x111, agilex::Motion{1000, -250})));
}

TEST(AgilexProfile, ATooLargeTwistKeepsItsCurvature) {
  Bridge b;
  b.to_enabled();
  b.profile.set_command({65.534, -10.0});
  EXPECT_EQ(newest(b.tick(), 0x111), agilex::encode(0x111, agilex::Motion{32767, -5000}));
}

TEST(AgilexProfile, AQuickStopCommandsZeroUntilStandstillThenStandby) {
  Bridge b;
  b.to_enabled();
  b.profile.set_command({1.0, 0.0});
  b.motion = {1000, 0};
  b.tick();
  b.profile.stop(StopKind::quick);
  auto out = b.tick_for(500);
  EXPECT_EQ(count(out, 0x111), 25);
  EXPECT_EQ(newest(out, 0x111), kZero);
  EXPECT_EQ(count(out, 0x421), 0);
  EXPECT_EQ(b.phase(), DrivePhase::stopping);
  b.motion = {};
  out = b.tick();
  EXPECT_EQ(newest(out, 0x421), agilex::mode_frame(Mode::standby));
  EXPECT_EQ(b.phase(), DrivePhase::stopping);
  b.state.mode = Mode::standby;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::standby);
}

TEST(AgilexProfile, AChassisWhoseWheelsTurnIsNeverPutIntoStandby) {
  Bridge b;
  b.to_enabled();
  b.motion = {1000, 0};
  b.profile.stop(StopKind::quick);
  EXPECT_EQ(count(b.tick_for(6000), 0x421), 0);
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_THAT(b.reason(), ::testing::HasSubstr("its wheels still turn after a stop"));
}

TEST(AgilexProfile, AWayThatGrowsIsNoStandstillThoughTheSpeedReadsZero) {
  Bridge b;
  b.to_enabled();
  b.tick_for(200);
  EXPECT_TRUE(b.snapshot().standstill);
  b.profile.stop(StopKind::quick);
  for (int i = 0; i < 100; ++i) {
    b.odometry.left_mm += 10;
    EXPECT_EQ(count(b.tick(), 0x421), 0);
    EXPECT_FALSE(b.snapshot().standstill);
    EXPECT_TRUE(b.snapshot().turning);
  }
}

TEST(AgilexProfile, ACounterThatRestartsIsNoWheelThatTurns) {
  Bridge b;
  b.to_enabled();
  b.tick_for(200);
  b.odometry.left_mm += 5000;
  b.tick();
  EXPECT_FALSE(b.snapshot().turning);
  EXPECT_FALSE(b.snapshot().standstill) << "the window begins again";
}

TEST(AgilexProfile, TheFasterOfBothWitnessesIsHowFastAWheelMayTurn) {
  Bridge b;
  b.to_enabled();
  for (int i = 0; i < 20; ++i) {
    b.odometry.left_mm += 10;  // 0.5 m/s
    b.tick();
  }
  EXPECT_EQ(b.snapshot().wheels[0].speed_radps, 0.0);
  EXPECT_GT(b.snapshot().wheels[0].fastest_radps, 1.0);
}

TEST(AgilexProfile, WithoutFreshWitnessesBrakingEndsAfter3Seconds) {
  Bridge b;
  b.to_enabled();
  b.profile.stop(StopKind::quick);
  b.profile.distrust_standstill(b.now() + std::chrono::seconds{60});
  EXPECT_EQ(count(b.tick_for(3000), 0x421), 0);
  EXPECT_EQ(newest(b.tick(), 0x421), agilex::mode_frame(Mode::standby));
}

TEST(AgilexProfile, AStandstillThatIsNotToBeBelievedDoesNotEndBraking) {
  Bridge b;
  b.to_enabled();
  b.profile.distrust_standstill(b.now() + std::chrono::milliseconds{1000});
  b.profile.stop(StopKind::quick);
  EXPECT_EQ(count(b.tick_for(900), 0x421), 0);
  EXPECT_EQ(newest(b.tick_for(200), 0x421), agilex::mode_frame(Mode::standby));
}

TEST(AgilexProfile, DisableLeavesTheBrakingOutUnlessAWheelTurns) {
  Bridge stands;
  stands.to_enabled();
  stands.profile.stop(StopKind::disable);
  EXPECT_EQ(newest(stands.tick(), 0x421), agilex::mode_frame(Mode::standby));
  Bridge turns;
  turns.to_enabled();
  turns.motion = {1000, 0};
  turns.profile.stop(StopKind::disable);
  EXPECT_EQ(count(turns.tick_for(1000), 0x421), 0);
}

TEST(AgilexProfile, AStopRevokesAChangeOfModeThatIsUnderWay) {
  Bridge b;
  b.tick();
  b.profile.enable();
  b.tick();
  b.profile.stop(StopKind::quick);
  auto out = b.tick();
  EXPECT_EQ(newest(out, 0x421), agilex::mode_frame(Mode::standby));
  EXPECT_EQ(b.phase(), DrivePhase::stopping);
  b.tick_for(80);
  EXPECT_EQ(b.phase(), DrivePhase::stopping);
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::standby);
}

TEST(AgilexProfile, AnExceptionIsLatchedUntilReset) {
  Bridge b;
  b.to_enabled();
  b.profile.set_command({1.0, 0.0});
  b.state = {Condition::exception, Mode::can, 21.9, 0x0001, 0};
  b.motion = {500, 0};
  auto out = b.tick();
  EXPECT_EQ(newest(out, 0x111), kZero);
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_EQ(b.reason(),
            "chassis: reports an exception, error 0x0001 (bits: see the chassis' manual, frame "
            "0x211), battery 21.9 V");
  b.state = {};
  b.motion = {};
  out = b.tick_for(5000);
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_EQ(count(out, 0x441), 0);
  b.profile.enable();
  b.profile.set_command({1.0, 0.0});
  EXPECT_THAT(b.tick(), IsEmpty());
  b.profile.reset_fault();
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::standby);
}

TEST(AgilexProfile, ResetClearsTheExceptionOfTheChassisOrGivesUp) {
  Bridge b;
  b.state.condition = Condition::exception;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  b.profile.reset_fault();
  const auto out = b.tick_for(1000);
  EXPECT_EQ(count(out, 0x441), 10);
  EXPECT_EQ(b.phase(), DrivePhase::starting);
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  b.profile.reset_fault();
  b.tick();
  b.state.condition = Condition::normal;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::standby);
}

TEST(AgilexProfile, ThePressedEmergencyStopIsNamed) {
  Bridge b;
  b.to_enabled();
  b.state.condition = Condition::emergency_stop;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_EQ(b.reason(), "chassis: emergency stop is pressed: release it, then reset");
  EXPECT_EQ(b.snapshot().wheels[0].state, "EmergencyStop");
}

TEST(AgilexProfile, RemoteControlTakingOverIsAFault) {
  Bridge b;
  b.to_enabled();
  b.state.mode = Mode::remote_mini;
  EXPECT_THAT(b.tick(), IsEmpty());
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_THAT(b.reason(), HasSubstr("is now in RemoteControl"));
}

TEST(AgilexProfile, SilenceOfTheChassisIsAFaultAfterTheFeedbackTimeout) {
  Bridge b;
  b.to_enabled();
  b.silent = true;
  b.tick_for(80);
  EXPECT_EQ(b.phase(), DrivePhase::enabled);
  EXPECT_TRUE(b.snapshot().feedback_fresh);
  EXPECT_EQ(newest(b.tick(), 0x111), kZero);
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_FALSE(b.snapshot().feedback_fresh);
  EXPECT_FALSE(b.snapshot().standstill) << "not known";
  EXPECT_THAT(b.reason(), HasSubstr("no 0x211, 0x221, 0x311 for 100 ms"));
}

TEST(AgilexProfile, ARunningChassisIsBrakedBeforeStandby) {
  Bridge b;
  b.state.mode = Mode::can;
  b.motion = {800, 0};
  auto out = b.tick_for(200);
  EXPECT_EQ(count(out, 0x111), 10);
  EXPECT_EQ(newest(out, 0x111), kZero);
  EXPECT_EQ(count(out, 0x421), 0);
  b.motion = {};
  EXPECT_EQ(newest(b.tick(), 0x421), agilex::mode_frame(Mode::standby));
  b.state.mode = Mode::standby;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::standby);
}

TEST(AgilexProfile, CanModeThatWasNotRequestedIsAFault) {
  Bridge b;
  b.tick();
  b.state.mode = Mode::can;
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_THAT(b.reason(), HasSubstr("without having been armed"));
}

TEST(AgilexProfile, WhoCommandsBesidesTheBridgeStopsTheChassisUntilAReset) {
  for (const std::uint32_t id : {0x111u, 0x421u, 0x441u}) {
    Bridge b;
    b.to_enabled();
    b.profile.on_frame(CanFrame::make(id, {1, 0, 0, 0, 0, 0, 0, 0}), kStart);
    const std::string name = fmt::format("0x{:03X}", id);
    EXPECT_EQ(b.reason(), "another sender uses " + name + ": only one master may command");
    EXPECT_EQ(newest(b.tick(), 0x111), kZero);
    EXPECT_EQ(b.profile.counters().intruder_frames, 1);
    EXPECT_EQ(b.profile.intruder(), name + " from another sender");
    b.state.mode = Mode::standby;
    b.tick_for(200);
    EXPECT_EQ(b.phase(), DrivePhase::faulted);
    b.profile.reset_fault();
    EXPECT_EQ(b.profile.intruder(), "");
    b.tick_for(200);
    EXPECT_EQ(b.phase(), DrivePhase::standby);
  }
}

TEST(AgilexProfile, MalformedReportsAreCountedAndRefreshNothing) {
  Bridge b;
  b.to_enabled();
  b.silent = true;
  for (int i = 0; i < 5; ++i) {
    b.profile.on_frame(CanFrame::make(0x211, {0, 1}), kStart + ms(60 + 20 * i));
    b.profile.on_frame(CanFrame::make(0x221, {0, 0}), kStart + ms(60 + 20 * i));
    b.profile.on_frame(CanFrame::make(0x311, {0}), kStart + ms(60 + 20 * i));
    b.tick();
  }
  EXPECT_EQ(b.profile.counters().rejected_frames, 15);
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
}

TEST(AgilexProfile, WheelFeedbackIsInSiUnitsAtTheRim) {
  Bridge b;
  b.odometry = {INT32_MAX - 50, -7};
  b.tick();
  EXPECT_EQ(b.snapshot().wheels[0].position_counts, 0) << "counts from start-up on";
  b.odometry = {INT32_MIN + 49, -107};  // 100 mm on, through the wrap; 100 mm back
  b.motion = {600, 500};
  b.tick();
  const DrivetrainSnapshot s = b.snapshot();
  EXPECT_TRUE(s.wheels[0].valid);
  EXPECT_EQ(s.wheels[0].position_counts, 100);
  EXPECT_DOUBLE_EQ(s.wheels[0].angle_rad, 0.1 / kRadius_m);
  EXPECT_DOUBLE_EQ(s.wheels[1].angle_rad, -0.1 / kRadius_m);
  EXPECT_NEAR(s.wheels[0].speed_radps, 0.3 / kRadius_m, 1e-12);
  EXPECT_NEAR(s.wheels[1].speed_radps, 0.9 / kRadius_m, 1e-12);
  EXPECT_FALSE(s.standstill);
}

TEST(AgilexProfile, AJumpOfTheOdometerMeansARestartAndIsNoMotion) {
  Bridge b;
  b.odometry = {5000, 5000};
  b.to_enabled();
  b.odometry = {6000, 6000};
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::enabled);
  EXPECT_EQ(b.snapshot().wheels[0].position_counts, 1000);
  b.odometry = {4999, 4999};
  b.tick();
  EXPECT_EQ(b.phase(), DrivePhase::faulted);
  EXPECT_THAT(b.reason(), HasSubstr("it has restarted"));
  EXPECT_EQ(b.snapshot().wheels[0].position_counts, 1000);
}

TEST(AgilexProfile, HearsAndReportsNothingButItsOwnFrames) {
  AgilexV2Profile profile(agilex_chassis(), kRadius_m, kTrack_m);
  const auto passes = [&](const CanFrame& frame) {
    const auto filters = profile.filters();
    return std::any_of(filters.begin(), filters.end(),
                       [&](const CanFilter& filter) { return filter.passes(frame); });
  };
  EXPECT_TRUE(passes(agilex::encode(agilex::SystemState{})));
  EXPECT_TRUE(passes(agilex::clear_frame()));
  EXPECT_FALSE(passes(CanFrame::make(0x210, {})));
  EXPECT_FALSE(passes(CanFrame::make(0x181, {})));
}

}  // namespace
}  // namespace tether
