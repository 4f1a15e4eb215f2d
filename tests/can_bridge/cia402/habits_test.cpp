#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Behaviour of real drives that the standard does not define, or leaves to them.
namespace tether {
namespace {

using canopen::DriveState;
using test::Bench;
using test::emergency;
using test::milliseconds;
using test::two_nodes;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// ---------------------------------------------------------------------------- slow ones

/// Until `phase`; the right drive takes 3 s from each NMT reset to its boot-up message, so that a
/// reset in between restarts it.
bool reach_with_slow_boot(Bench& bench, DrivePhase phase) {
  bench.right().boots = false;
  int resets = 0;
  Instant since{};
  return bench.run_until([&] {
    if (bench.right().resets != resets) {
      resets = bench.right().resets;
      since = bench.now;
    } else if (resets > 0 && bench.now - since >= milliseconds(3000) && since != Instant{}) {
      std::vector<CanFrame> out;
      bench.right().reboot(out);
      for (const CanFrame& f : out) bench.deliver(f);
      since = Instant{};
    }
    return bench.phase() == phase;
  });
}

TEST(Cia402Habits, ADriveThatRebootsWithEachResetHasTwiceAsLongTheSecondTime) {
  Bench bench;
  bench.profile.start(bench.now);
  EXPECT_TRUE(reach_with_slow_boot(bench, DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.right().resets, 2);
  EXPECT_EQ(bench.left().resets, 1);
}

TEST(Cia402Habits, ADriveThatIsNotReadyForSdoAfterItsBootUpMessageIsWaitedFor) {
  Bench bench;
  bench.right().unanswered = {{0x1000, 0}};
  bench.profile.start(bench.now);
  bench.run(milliseconds(1900));  // more than three tries of 500 ms
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  EXPECT_THAT(bench.reason(), HasSubstr("right drive (node 2): waiting for its first SDO answer"));
  bench.right().unanswered.reset();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.right().resets, 1);
}

TEST(Cia402Habits, ADriveThatNeverAnswersSdoIsRefused) {
  Bench bench;
  bench.right().unanswered = {{0x1000, 0}};
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(4000)));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): no answer to reading of 0x1000:0 (device type) in 3 tries of "
            "500 ms: check the CAN plug and termination, and that no other device has node id 2; "
            "if it answers more slowly, raise drives.boot_timeout_ms");
}

TEST(Cia402Habits, AnswersMayTakeAQuarterOfASecond) {
  Bench bench;
  bench.sdo_delay = milliseconds(250);
  bench.profile.start(bench.now);
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  // Nothing was asked twice; what each drive was asked when it was reset is answered too late.
  EXPECT_LE(bench.profile.counters().rejected_frames, 2);
}

TEST(Cia402Habits, AnAnswerThatIsAskedForAgainIsNamedAsAwaited) {
  Bench bench;
  bench.left().unanswered = {{0x1017, 0}};
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.reason().find("0x1017") != std::string::npos; }));
  EXPECT_THAT(bench.reason(), Not(HasSubstr("waiting")));
  bench.run(milliseconds(540));
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): step 3 of"));
  EXPECT_THAT(bench.reason(), HasSubstr("(heartbeat producer), waiting for its SDO answer"));
}

// ---------------------------------------------------------------------------- identifiers

/// Values written to subindex 1 of the PDO parameters `index` of node 1.
std::vector<std::int64_t> identifiers(const Bench& bench, std::uint16_t index) {
  std::vector<std::int64_t> written;
  for (const CanFrame& f : bench.log) {
    if (f.id != 0x601 || f.data[0] != 0x23 || f.data[3] != 1) continue;
    if ((f.data[1] | f.data[2] << 8) != index) continue;
    written.push_back(canopen::read_integer(f.data.data() + 4, 4, false));
  }
  return written;
}

TEST(Cia402Habits, Bit30OfAnIdentifierStaysAsTheDriveHasIt) {
  Bench bench;
  bench.left().insisted_bits = {{0x1800, 1}};
  bench.to_standby();
  EXPECT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  EXPECT_THAT(identifiers(bench, 0x1800), ElementsAre(0xC0000181, 0x40000181));
  EXPECT_THAT(identifiers(bench, 0x1801), ElementsAre(0x80000281, 0x281));
  EXPECT_THAT(identifiers(bench, 0x1400), ElementsAre(0x80000201, 0x201));
}

TEST(Cia402Habits, NoOtherBitOfAnIdentifierIsKept) {
  Bench bench;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.reason().find("0x1017") != std::string::npos; }));
  bench.left().set_object(0x1800, 1, 0xFFFFFFFF);
  ASSERT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_THAT(identifiers(bench, 0x1800), ElementsAre(0xC0000181, 0x40000181));
}

TEST(Cia402Habits, APdoThatStaysOffIsRefused) {
  Bench bench;
  bench.left().clamps[{0x1800, 1}] = 0xC0000181;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(),
              HasSubstr("0x1800:1 (TPDO1 identifier) reads 0xC0000181 instead of 0x181"));
}

// ---------------------------------------------------------------------------- mode of operation

TEST(Cia402Habits, AModeThatIsShownOnlyWhenEnabledIsCheckedThen) {
  Bench bench;
  for (test::FakeDrive& d : bench.drives) d.shows_mode_late = true;
  bench.drive({1.0, 0.0});
  ASSERT_EQ(bench.phase(), DrivePhase::enabled) << bench.reason();
  EXPECT_GT(bench.left_axis().speed, 0);
  bench.profile.stop(StopKind::quick);
  ASSERT_TRUE(bench.reach(DrivePhase::standby));
  bench.run(milliseconds(200));
  EXPECT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  EXPECT_EQ(bench.left().object(0x6061, 0), 0);
}

TEST(Cia402Habits, NoModeWhenEnabledIsAFaultAfterTheFeedbacksTimeout) {
  Bench bench;
  bench.right().shows_mode_late = true;
  bench.right().enabled_mode = 0;
  bench.to_standby();
  ASSERT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  bench.profile.enable();
  bench.profile.set_command({1.0, 0.0});
  ASSERT_TRUE(
      bench.run_until([&] { return bench.right_axis().state == DriveState::operation_enabled; }));
  for (int i = 0; i < 5; ++i) {
    bench.cycle();
    EXPECT_EQ(bench.phase(), DrivePhase::enabling) << i;
    EXPECT_EQ(bench.target(0x201), 0);
    EXPECT_EQ(bench.target(0x202), 0);
  }
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(
      bench.reason(),
      "right drive (node 2): mode of operation is 0, not 3 (profile velocity): the drive shows "
      "none. If its mode display blinks, leave mode_display out of the TPDOs");
}

TEST(Cia402Habits, AnotherModeWhenEnabledIsAFaultAtOnce) {
  Bench bench;
  bench.right().shows_mode_late = true;
  bench.right().enabled_mode = 1;
  bench.to_standby();
  bench.profile.enable();
  ASSERT_TRUE(
      bench.run_until([&] { return bench.right_axis().state == DriveState::operation_enabled; }));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_THAT(bench.reason(), HasSubstr("right drive (node 2): mode of operation is 1, not 3"));
}

TEST(Cia402Habits, ADriveThatShowedItsModeMustGoOnShowingIt) {
  Bench bench;
  bench.left().shows_mode_late = true;
  bench.to_standby();
  bench.right().shows_mode_late = true;
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_THAT(bench.reason(), HasSubstr("right drive (node 2): mode of operation is 0, not 3"));
}

TEST(Cia402Habits, EachStartAsksAgainWhetherADriveIsSlowOrShowsItsModeLate) {
  Bench bench;
  bench.right().shows_mode_late = true;
  bench.to_standby();
  bench.right().shows_mode_late = false;
  bench.right().unanswered = {{0x1000, 0}};
  bench.deliver(CanFrame::make(0x702, {0x00}));
  ASSERT_EQ(bench.phase(), DrivePhase::faulted);
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.run_until([&] { return bench.right().resets == 2; }));
  bench.run(milliseconds(1900));
  EXPECT_EQ(bench.phase(), DrivePhase::starting) << bench.reason();
  bench.right().unanswered.reset();
  ASSERT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  bench.right().shows_mode_late = true;
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Habits, NoSetpointLeavesBeforeTheModeIsShown) {
  Bench bench;
  bench.right().shows_mode_late = true;
  bench.right().enabled_mode = 0;
  bench.to_standby();
  bench.profile.enable();
  ASSERT_TRUE(
      bench.run_until([&] { return bench.right_axis().state == DriveState::operation_enabled; }));
  bench.run(milliseconds(60));
  EXPECT_EQ(bench.phase(), DrivePhase::enabling);
  bench.right().enabled_mode.reset();
  EXPECT_TRUE(bench.reach(DrivePhase::enabled, milliseconds(40))) << bench.reason();
}

TEST(Cia402Habits, AModeThatChangesWhileEnabledIsAFaultAtOnce) {
  for (const std::int64_t mode : {0, 1}) {
    Bench bench;
    bench.right().shows_mode_late = true;
    bench.drive({1.0, 0.0});
    bench.right().enabled_mode = mode;
    bench.cycle();
    EXPECT_EQ(bench.phase(), DrivePhase::faulted) << mode;
    bench.right().enabled_mode.reset();
    bench.profile.reset_fault();
    EXPECT_EQ(bench.phase(), DrivePhase::starting);  // its configuration may be lost
    EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  }
}

TEST(Cia402Habits, AModeThatNoFeedbackTellsMustBeShownInStartUp) {
  Cia402Config config = two_nodes();
  for (PdoConfig& p : config.pdos) {
    if (p.node == 1) std::erase(p.objects, test::kModeDisplay);
  }
  Bench good(config);
  good.to_enabled();
  EXPECT_EQ(good.phase(), DrivePhase::enabled) << good.reason();
  Bench bench(config);
  bench.left().shows_mode_late = true;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): 0x6061:0 (mode of operation) reads 0 instead of 3: correct the "
            "drivetrain file to what the drive allows, see its manual; a drive that shows its mode "
            "only when enabled needs mode_display in a TPDO");
}

TEST(Cia402Habits, AModeThatCannotBeSetIsRefused) {
  Bench bench;
  bench.left().aborts[{0x6060, 0}] = 0x06090030;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), HasSubstr("writing 0x6060:0 (mode of operation) aborted"));
}

// ---------------------------------------------------------------------------- messages

TEST(Cia402Habits, AnEmergencyMessageThatTheFileCallsAWarningIsReportedAndCountedOnly) {
  Cia402Config config = two_nodes();
  config.emcy_warnings = {0x8110, 0x4210};
  Bench bench(config);
  bench.drive({1.0, 0.0});
  EXPECT_EQ(bench.profile.warnings(), "");
  for (const std::uint16_t code : {0x8110, 0x4210, 0x8110}) bench.deliver(emergency(2, code));
  bench.deliver(emergency(1, 0x8110));
  bench.run(milliseconds(100));
  EXPECT_EQ(bench.phase(), DrivePhase::enabled) << bench.reason();
  EXPECT_EQ(bench.snapshot().wheels[1].error_code, 0u);
  EXPECT_EQ(bench.profile.counters().warnings, 4);
  EXPECT_EQ(bench.profile.warnings(),
            "right drive (node 2): 0x8110 (CAN overrun: messages lost); right drive (node 2): "
            "0x4210 (device too hot); left drive (node 1): 0x8110 (CAN overrun: messages lost)");
  bench.deliver(emergency(2, 0x8120));  // not in the list
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  bench.profile.reset_fault();
  EXPECT_EQ(bench.profile.warnings(), "");
  EXPECT_EQ(bench.profile.counters().warnings, 4);
}

TEST(Cia402Habits, AHeartbeatMayToggleItsBit7) {
  Bench bench;
  bench.to_standby();
  bench.right().beat = false;
  for (int i = 0; i < 10; ++i) {
    bench.deliver(CanFrame::make(0x702, {static_cast<std::uint8_t>(i % 4 == 3 ? 0x05 : 0x85)}));
    bench.run(milliseconds(100));
    EXPECT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  }
  EXPECT_EQ(bench.profile.counters().rejected_frames, 0);
  bench.deliver(CanFrame::make(0x702, {0xFF}));  // pre-operational
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Habits, OnlyZeroIsABootUpMessage) {
  Bench bench;
  bench.to_standby();
  bench.deliver(CanFrame::make(0x702, {0x80}));
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  EXPECT_EQ(bench.profile.counters().rejected_frames, 1);
  bench.deliver(CanFrame::make(0x702, {0x00}));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

}  // namespace
}  // namespace tether
