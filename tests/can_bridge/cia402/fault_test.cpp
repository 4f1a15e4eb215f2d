#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Latched faults: their causes, what both wheels do then, and how they are left.
namespace tether {
namespace {

using canopen::DriveState;
using test::Bench;
using test::emergency;
using test::expect_left_stops_and_stays_stopped;
using test::milliseconds;
using ::testing::HasSubstr;

void reboot(Bench& bench, test::FakeDrive& drive) {
  std::vector<CanFrame> out;
  drive.reboot(out);
  for (const CanFrame& f : out) bench.deliver(f);
}

TEST(Cia402Fault, AFaultOfTheRightDriveStopsTheLeftToo) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.right().trip(bench.right_axis(), 0x3210);
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): fault 0x3210 (DC link over-voltage: battery full while "
            "braking?): remove the cause, then reset");
  EXPECT_EQ(bench.snapshot().wheels[1].error_code, 0x3210u);
  EXPECT_EQ(bench.snapshot().wheels[1].state, "Fault");
  expect_left_stops_and_stays_stopped(bench);
}

TEST(Cia402Fault, FaultReactionCountsAlready) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(0x182, {0x1F, 0x02, 0, 0, 0, 0}));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Fault, TheErrorCodeMayComeAfterTheStatusword) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(0x182, {0x18, 0x02, 0, 0, 0, 0}));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): fault, error code not known yet: remove the cause, then reset");
  bench.deliver(CanFrame::make(0x282, {0, 0, 0, 0, 0x20, 0x23, 3}));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): fault 0x2320 (short circuit or earth leakage): remove the "
            "cause, then reset");
}

TEST(Cia402Fault, AnEmergencyMessageIsReportedWithItsCode) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(emergency(2, 0x8130));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): emergency 0x8130 (heartbeat of the bridge lost): remove the "
            "cause, then reset");
  EXPECT_EQ(bench.snapshot().wheels[1].error_code, 0x8130u);
  expect_left_stops_and_stays_stopped(bench);
}

TEST(Cia402Fault, AnEmergencyMessageWithoutErrorIsNone) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(emergency(2, 0x0000));
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::enabled);
}

TEST(Cia402Fault, FeedbackOfAnotherLengthIsNamed) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.right().silent = true;
  bench.deliver(CanFrame::make(0x182, {0x37, 0x02, 0, 0, 0, 0, 0, 0}));
  bench.run(milliseconds(120));
  EXPECT_EQ(
      bench.reason(),
      "right drive (node 2): its TPDOs do not have the length of the file's mapping: 0x182 has "
      "8 bytes instead of 6. Map what the drive sends; for a drive that pads its TPDOs to 8 "
      "bytes, map objects that fill them");
}

TEST(Cia402Fault, ABootUpMessageOfADriveThatGoesOnIsNotCalledAReboot) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(0x702, {0x00}));
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  bench.run(milliseconds(150));  // its next heartbeat
  EXPECT_THAT(bench.reason(),
              HasSubstr("right drive (node 2): sent a boot-up message, but is still operational"));
}

TEST(Cia402Fault, ARebootNeedsAFullStartUp) {
  Bench bench;
  bench.drive({1.0, 0.0});
  reboot(bench, bench.right());
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): rebooted: full start-up needed; check its supply voltage");
  expect_left_stops_and_stays_stopped(bench);
  const int resets = bench.left().resets;
  bench.profile.reset_fault();
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  ASSERT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.left().resets, resets + 1);
  EXPECT_EQ(bench.right().object(0x1016, 1), 0x007F00FA);
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  // The next fault is one of its own: clearing it is enough.
  bench.right().trip(bench.right_axis(), 0x3210);
  bench.run(milliseconds(100));
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::standby, milliseconds(500)));
  EXPECT_EQ(bench.left().resets, resets + 1);
}

TEST(Cia402Fault, TheAngleDoesNotJumpWhenADriveReboots) {
  Bench bench;
  bench.drive({1.0, 0.0}, milliseconds(2000));
  const std::int64_t before = bench.snapshot().wheels[0].position_counts;
  ASSERT_GT(before, 4096);
  reboot(bench, bench.left());
  bench.cycle();
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::standby));
  EXPECT_EQ(bench.snapshot().wheels[0].position_counts, before);
}

TEST(Cia402Fault, TheAngleDoesNotJumpAtTheFirstFeedbackAfterABoot) {
  Bench bench;
  bench.drive({1.0, 0.0}, milliseconds(400));
  const std::int64_t before = bench.snapshot().wheels[0].position_counts;
  ASSERT_GT(before, 100);
  ASSERT_LT(before, 4096);  // too little for its size alone to give it away
  bench.deliver(CanFrame::make(0x701, {0x00}));
  bench.deliver(CanFrame::make(0x281, {0, 0, 0, 0, 0, 0, 3}));
  EXPECT_EQ(bench.snapshot().wheels[0].position_counts, before);
}

TEST(Cia402Fault, TheFirstCauseIsTheOneThatIsReported) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(emergency(2, 0x3210));
  const std::string first = bench.reason();
  bench.deliver(emergency(1, 0x8130));
  bench.right().beat = false;
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.reason(), first);
}

TEST(Cia402Fault, AMissingHeartbeatFaultsExactlyAtItsTimeout) {
  Bench bench;
  bench.to_standby();
  bench.left().beat = bench.right().beat = false;
  bench.deliver(CanFrame::make(0x701, {0x05}));
  const Instant last = bench.now + milliseconds(1);
  std::vector<CanFrame> out;
  bench.profile.on_frame(CanFrame::make(0x702, {0x05}), last + milliseconds(100));
  bench.profile.tick(last + milliseconds(300) - Duration{1}, out);
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  bench.profile.tick(last + milliseconds(300), out);
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): no heartbeat for 300 ms: check its supply and the CAN plug");
}

TEST(Cia402Fault, ASilentDriveFaultsByItsFeedbackThenSaysThatTheHeartbeatIsGone) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.right().silent = true;
  bench.run(milliseconds(120));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): feedback older than 100 ms (TPDOs 0x182, 0x282): check its "
            "supply and the CAN plug");
  expect_left_stops_and_stays_stopped(bench);
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): no heartbeat for 300 ms: check its supply and the CAN plug; "
            "right drive (node 2): stop not confirmed within 200 ms: heartbeat and setpoints are "
            "withheld, so that the drive's own watchdog stops it");
  // It cannot be seen to stand: the stop stays commanded.
  EXPECT_EQ(bench.controlword(0x202), 0x0002);
  bench.profile.reset_fault();
  const int resets = bench.left().resets;
  bench.run(milliseconds(1900));
  EXPECT_EQ(bench.left().resets, resets);  // its watchdog needs time
  bench.run(milliseconds(400));
  EXPECT_EQ(bench.left().resets, resets + 1);
  bench.right().silent = false;
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
}

TEST(Cia402Fault, OldFeedbackFaultsExactlyAtItsTimeoutWhileEnabled) {
  Bench bench;
  bench.to_enabled();
  const Instant last = bench.now - Bench::kCycle + milliseconds(1);
  std::vector<CanFrame> out;
  bench.profile.tick(last + milliseconds(100) - Duration{1}, out);
  EXPECT_EQ(bench.phase(), DrivePhase::enabled);
  bench.profile.tick(last + milliseconds(100), out);
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Fault, OneOldSignalOfOneWheelIsEnough) {
  Bench bench;
  bench.drive({1.0, 0.0});
  for (int i = 0; i < 6; ++i) {
    // Everything but the right wheel's position.
    bench.left().send_feedback = true;
    bench.right().send_feedback = false;
    bench.deliver(CanFrame::make(0x182, {0x37, 0x02, 0, 0, 0, 0}));
    bench.cycle();
  }
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Fault, OldFeedbackInStandbyIsShownButNoFault) {
  Bench bench;
  bench.to_standby();
  bench.left().send_feedback = false;
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  EXPECT_FALSE(bench.snapshot().feedback_fresh);
  bench.profile.enable();
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Fault, AHeartbeatThatIsNotOperationalNeedsAFullStartUp) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(0x702, {0x7F}));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): left the operational state (pre-operational): full start-up "
            "needed");
  expect_left_stops_and_stays_stopped(bench);
  bench.profile.reset_fault();
  bench.run(milliseconds(400));
  EXPECT_EQ(bench.right().resets, 2);
}

TEST(Cia402Fault, LeavingOperationEnabledUnaskedFaults) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(0x182, {0x50, 0x02, 0, 0, 0, 0}));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): went from OperationEnabled to SwitchOnDisabled unasked: check "
            "its main supply, STO and enable inputs");
  expect_left_stops_and_stays_stopped(bench);
}

TEST(Cia402Fault, FallingBackWhileTheOtherAxisStillClimbsFaults) {
  Bench bench;
  bench.to_standby();
  bench.enable_verified();
  bench.right_axis().stuck_below = DriveState::ready_to_switch_on;
  bench.run(milliseconds(200));
  bench.left().send_feedback = false;
  bench.deliver(CanFrame::make(0x181, {0x33, 0x02, 0, 0, 0, 0}));
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_THAT(bench.reason(), ::testing::HasSubstr("left drive (node 1): fell back to SwitchedOn"));
}

TEST(Cia402Fault, APowerStageThatIsOnInStandbyFaults) {
  Bench bench;
  bench.to_standby();
  bench.deliver(CanFrame::make(0x181, {0x37, 0x02, 0, 0, 0, 0}));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): is in OperationEnabled unasked: who switched it on?");
}

TEST(Cia402Fault, AnotherModeOfOperationFaults) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(0x282, {0, 0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): mode of operation is 1, not 3 (profile velocity): another tool "
            "changed it?");
  expect_left_stops_and_stays_stopped(bench);
}

TEST(Cia402Fault, ADriveInFaultAtStartUpIsShownWithItsCode) {
  Bench bench;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.left().object(0x6060, 0) == 3; }));
  bench.left().trip(bench.left_axis(), 0x3220);
  ASSERT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(2000)));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): fault 0x3220 (DC link under-voltage: battery, contactor, fuse): "
            "remove the cause, then reset");
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(1000)));
}

TEST(Cia402Fault, AStandingHealthyWheelGetsAQuickStopToo) {
  Bench bench;
  bench.to_enabled();
  bench.right().trip(bench.right_axis(), 0x3210);
  bench.cycle();
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x201), 0x0000);
}

TEST(Cia402Fault, OnceAWheelStoodItsPowerStageStaysOffWithoutFeedbackToo) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.right().trip(bench.right_axis(), 0x3210);
  bench.cycle();
  while (bench.left_axis().speed != 0) bench.cycle();
  bench.run(milliseconds(120));
  bench.left().send_feedback = false;
  bench.cycle();
  ASSERT_EQ(bench.controlword(0x201), 0x0000);
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x201), 0x0000);
}

}  // namespace
}  // namespace tether
