#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Start-up of drives that something is wrong with.
namespace tether {
namespace {

using test::Bench;
using test::milliseconds;
using test::two_nodes;

TEST(Cia402Refusal, AMissingDriveIsResetTwiceThenRefusedWithWhatToCheck) {
  Bench bench;
  bench.left().boots = false;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): no boot-up message within 4 s: is it powered, is the bit rate "
            "right, is its node id 1? If it boots more slowly, raise drives.boot_timeout_ms");
  EXPECT_EQ(bench.left().resets, 2);
  EXPECT_EQ(bench.right().resets, 1);
}

TEST(Cia402Refusal, ALateBootUpMessageIsInTimeAfterTheSecondReset) {
  Bench bench;
  bench.right().boots = false;
  bench.profile.start(bench.now);
  bench.run(milliseconds(1500));
  bench.right().boots = true;
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.right().resets, 2);
}

TEST(Cia402Refusal, WaitingForTheBootUpMessageIsSaid) {
  Bench bench;
  bench.right().boots = false;
  bench.profile.start(bench.now);
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  EXPECT_THAT(bench.reason(),
              ::testing::HasSubstr("right drive (node 2): waiting for its boot-up message"));
}

TEST(Cia402Refusal, AnAbortOfARequiredObjectIsRefusedWithItsMeaning) {
  Bench bench;
  bench.right().aborts[{0x605A, 0}] = 0x06020000;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): writing 0x605A:0 (quick stop option) aborted: 0x06020000 (no "
            "such object): choose the drivetrain file of this drive");
}

TEST(Cia402Refusal, AnAbortOfAnOptionalObjectIsNoted) {
  Bench bench;
  bench.left().aborts[{0x6007, 0}] = 0x06020000;
  bench.left().aborts[{0x1400, 5}] = 0x06090011;
  bench.to_standby();
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  EXPECT_THAT(bench.profile.notes(),
              ::testing::ElementsAre(
                  "left drive (node 1): writing 0x6007:0 (abort connection option) aborted: "
                  "0x06020000 (no such object)",
                  "left drive (node 1): writing 0x1400:5 (RPDO1 deadline) aborted: 0x06090011 (no "
                  "such subindex)"));
}

TEST(Cia402Refusal, ARequiredSetpointDeadlineThatTheDriveLacksIsRefused) {
  Cia402Config config = two_nodes();
  for (PdoConfig& p : config.pdos) p.event_timer_required = true;
  Bench bench(config);
  bench.left().aborts[{0x1400, 5}] = 0x06090011;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), ::testing::HasSubstr("0x1400:5 (RPDO1 deadline)"));
}

TEST(Cia402Refusal, ADriveWithoutWatchdogIsRefused) {
  Bench bench;
  bench.left().aborts[{0x1016, 1}] = 0x06020000;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): no drive-side watchdog is set (writing 0x1016:1 (heartbeat "
            "consumer) aborted: 0x06020000 (no such object)): its wheel would turn on if this "
            "computer or the cable failed; name the drive's own watchdog in the drivetrain file");
}

TEST(Cia402Refusal, AWatchdogThatReadsBackZeroIsNone) {
  Bench bench;
  bench.left().clamps[{0x1016, 1}] = 0;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(),
              ::testing::HasSubstr("0x1016:1 (heartbeat consumer) reads 0x0 instead of 0x7F00FA"));
}

TEST(Cia402Refusal, AWatchdogWhoseReactionCannotBeSetIsRefused) {
  Cia402Config config = two_nodes();
  std::erase_if(config.setup, [](const SetupWrite& s) { return s.object.index == 0x6007; });
  for (WatchdogConfig& w : config.watchdogs) {
    w.reaction = ObjectRef{0x6007, 0, 2, true};
    w.reaction_value = 3;
  }
  Bench good(config);
  good.to_standby();
  EXPECT_EQ(good.left().object(0x6007, 0), 3);
  Bench bench(config);
  bench.left().clamps[{0x6007, 0}] = 0;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): 0x6007:0 (reaction of the watchdog) reads 0 instead of 3: "
            "correct the drivetrain file to what the drive allows, see its manual");
}

TEST(Cia402Refusal, AWatchdogOfZeroMillisecondsIsNone) {
  Cia402Config config = two_nodes();
  config.watchdogs[0].timeout_ms = 0;
  Bench bench(config);
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), ::testing::HasSubstr("left drive (node 1): no drive-side watchdog"));
}

TEST(Cia402Refusal, NoWatchdogConfiguredIsRefused) {
  Cia402Config config = two_nodes();
  config.watchdogs.pop_back();
  Bench bench(config);
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), ::testing::HasSubstr("right drive (node 2): no drive-side watchdog "
                                                   "is set (none configured)"));
}

TEST(Cia402Refusal, OneOfTwoWatchdogsIsEnough) {
  Cia402Config config = two_nodes();
  config.watchdogs.push_back({1, WatchdogConfig::Kind::milliseconds, {0x2000, 0, 2, false}, 300});
  Bench bench(config);
  bench.left().aborts[{0x1016, 1}] = 0x06020000;
  bench.to_standby();
  EXPECT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  EXPECT_EQ(bench.left().object(0x2000, 0), 300);
}

TEST(Cia402Refusal, AValueThatDoesNotStickIsRefused) {
  Bench bench;
  bench.left().clamps[{0x6085, 0}] = 1000;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): 0x6085:0 (quick stop deceleration) reads 0x3E8 instead of 0xBB8: "
            "correct the drivetrain file to what the drive allows, see its manual");
}

TEST(Cia402Refusal, AMappingThatDoesNotStickIsRefused) {
  Bench bench;
  bench.left().clamps[{0x1600, 2}] = 0x60710010;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(),
              ::testing::HasSubstr("0x1600:2 (RPDO1 mapping) reads 0x60710010 instead of "
                                   "0x60FF0020"));
}

TEST(Cia402Refusal, TheDriveMayForbidRemoteRequestsOfItsPdos) {
  Bench bench;
  bench.left().clamps[{0x1801, 1}] = 0x40000281;
  bench.to_standby();
  EXPECT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
}

TEST(Cia402Refusal, TheModeIsWaitedForUntilTheStepTimeout) {
  Bench bench;
  bench.left().clamps[{0x6061, 0}] = 0;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until(
      [&] { return bench.reason().find("(mode of operation)") != std::string::npos; }));
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  bench.left().clamps.clear();
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(1000))) << bench.reason();
}

TEST(Cia402Refusal, AnotherModeIsRefused) {
  Bench bench;
  bench.left().clamps[{0x6061, 0}] = 1;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(),
              ::testing::HasSubstr("0x6061:0 (mode of operation) reads 1 instead of 3"));
}

TEST(Cia402Refusal, ASilentSdoServerIsRefusedAfterTheRetries) {
  Bench bench;
  bench.left().unanswered = {{0x1017, 0}};
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): no answer to writing of 0x1017:0 (heartbeat producer) in 3 tries "
            "of 500 ms: check the CAN plug and termination, and that no other device has node id "
            "1; if it answers more slowly, raise drives.sdo_timeout_ms");
}

TEST(Cia402Refusal, ALostReplyIsAskedForAgain) {
  Bench bench;
  bench.left().lost_replies = 2;
  bench.to_standby();
  EXPECT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
}

TEST(Cia402Refusal, ASegmentedReplyIsRefused) {
  Bench bench;
  bench.right().segmented = {{0x6085, 0}};
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): answers 0x6085:0 (quick stop deceleration) with a segmented "
            "transfer, that is with more than 4 bytes: choose the drivetrain file of this drive");
  EXPECT_EQ(bench.count(CanFrame::make(0x602, {0x80, 0x85, 0x60, 0, 0x01, 0, 0x04, 0x05})), 1);
}

TEST(Cia402Refusal, AWrongIndexInAReplyIsCountedAndNotTakenForTheAnswer) {
  Bench bench;
  bench.right().wrong_index = {{0x6085, 0}};
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), ::testing::HasSubstr("no answer to writing of 0x6085:0"));
  EXPECT_EQ(bench.profile.counters().rejected_frames, 3);
}

TEST(Cia402Refusal, ADeviceThatIsNoDriveIsRefused) {
  Bench bench;
  bench.left().set_object(0x1000, 0, 0x000F0191);
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): 0x1000:0 (device type) says device profile 401, not 402 "
            "(drives): another device has node id 1");
}

TEST(Cia402Refusal, ADriveThatRebootsDuringItsConfigurationIsConfiguredFromTheBeginning) {
  Bench bench;
  bench.profile.start(bench.now);
  bench.run(milliseconds(800));
  ASSERT_NE(bench.left().object(0x1016, 1), 0);
  std::vector<CanFrame> out;
  bench.left().reboot(out);
  for (const CanFrame& f : out) bench.deliver(f);
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.left().object(0x1016, 1), 0x007F00FA);
  EXPECT_EQ(bench.left().resets, 1);
}

TEST(Cia402Refusal, ADriveThatKeepsRebootingIsRefused) {
  Bench bench;
  bench.profile.start(bench.now);
  for (int i = 0; i < 3; ++i) {
    bench.run(milliseconds(500));
    bench.deliver(canopen::heartbeat_frame(2, canopen::NmtState::boot_up));
  }
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::refused);
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): rebooted 3 times during start-up: check its supply voltage");
}

TEST(Cia402Refusal, ADriveThatStaysPreOperationalIsRefusedAfterSeveralNmtStarts) {
  Bench bench;
  bench.right().beat = false;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.newest(0x080) != nullptr; }));
  bench.right().nmt = canopen::NmtState::pre_operational;
  ASSERT_TRUE(bench.reach(DrivePhase::refused)) << bench.reason();
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): not operational after NMT start: check the CAN wiring");
  EXPECT_GE(bench.count(CanFrame::make(0, {0x01, 2})), 3);
  EXPECT_EQ(bench.count(CanFrame::make(0, {0x01, 1})), 1);
}

TEST(Cia402Refusal, MissingFeedbackIsRefused) {
  Bench bench;
  bench.left().send_feedback = false;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): feedback older than 100 ms (TPDOs 0x181, 0x281): check its "
            "supply and the CAN plug");
}

TEST(Cia402Refusal, FeedbackMayTakeAWhileAfterNmtStart) {
  Bench bench;
  bench.left().send_feedback = false;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.newest(0x080) != nullptr; }));
  bench.run(milliseconds(600));
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  bench.left().send_feedback = true;
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(200))) << bench.reason();
}

TEST(Cia402Refusal, FeedbackThatEndsWhileTheWheelsAreWaitedForIsRefused) {
  Bench bench;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.newest(0x201) != nullptr; }));
  bench.left_axis().ramp = 0;
  bench.left_axis().speed = 20;
  bench.run(milliseconds(1000));
  bench.left().send_feedback = false;
  bench.run(milliseconds(980));
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(100)));
  EXPECT_THAT(bench.reason(), ::testing::HasSubstr("left drive (node 1): feedback older than"));
}

TEST(Cia402Refusal, ARefusedDrivetrainSendsNoSetpointsAndCanBeStartedAgain) {
  Bench bench;
  bench.left().boots = false;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  bench.profile.enable();
  bench.run(milliseconds(200));
  EXPECT_EQ(bench.phase(), DrivePhase::refused);
  EXPECT_EQ(bench.newest(0x201), nullptr);
  bench.left().boots = true;
  bench.profile.reset_fault();
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
}

}  // namespace
}  // namespace tether
