#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Drives that a stop does not reach by PDO.
namespace tether {
namespace {

using canopen::DriveState;
using canopen::NmtState;
using test::Bench;
using test::FakeDrive;
using test::milliseconds;
using test::two_nodes;
using ::testing::HasSubstr;
using ::testing::Not;

const CanFrame kSdoQuickStop = CanFrame::make(0x601, {0x2B, 0x40, 0x60, 0, 0x02, 0, 0, 0});
const CanFrame kSdoPowerOff = CanFrame::make(0x601, {0x2B, 0x40, 0x60, 0, 0, 0, 0, 0});

/// Drives that keep their last setpoint when they are not operational.
struct Watched : Bench {
  using Bench::Bench;
  /// Another's NMT command, to all.
  void nmt(std::uint8_t command) {
    const CanFrame frame = CanFrame::make(canopen::kNmt, {command, 0});
    std::vector<CanFrame> ignored;
    for (FakeDrive& d : drives) d.on_frame(frame, ignored);
    deliver(frame);
  }
  bool stands() { return left_axis().speed == 0 && right_axis().speed == 0; }
  bool off() {
    return left_axis().state == DriveState::switch_on_disabled &&
           right_axis().state == DriveState::switch_on_disabled;
  }
  /// The wheels' own watchdogs: quick stop once the bridge's heartbeat stays away for 250 ms.
  void run_with_watchdogs(milliseconds time) {
    for (milliseconds t{0}; t < time; t += kCycle) {
      cycle();
      const auto is_heartbeat = [](const CanFrame& f) { return f.id == 0x77F; };
      silence_ = std::ranges::any_of(sent, is_heartbeat) ? milliseconds(0) : silence_ + kCycle;
      for (FakeDrive& d : drives) d.runs_on = d.runs_on && silence_ < milliseconds(250);
    }
  }
  long count_setpoints(std::uint32_t id) const {
    return std::ranges::count_if(log, [id](const CanFrame& f) { return f.id == id; });
  }

 private:
  milliseconds silence_{0};
};

/// Such drives at 1 m/s.
struct Driving : Watched {
  explicit Driving(const Cia402Config& config = two_nodes()) : Watched(config) {
    for (FakeDrive& d : drives) d.runs_on = true;
    drive({1.0, 0.0}, milliseconds(600));
    EXPECT_GT(left_axis().speed, 50);
    log.clear();
  }
};

/// It refuses every SDO request that matters.
void refuse_stops(FakeDrive& d) {
  for (const std::uint16_t object : {0x6040, 0x6041, 0x606C, 0x6064}) {
    d.aborts[{object, 0}] = 0x08000022;
  }
}

/// Pre-operational by another's command, and neither takes its stop.
void take_from_bridge(Driving& bench) {
  for (FakeDrive& d : bench.drives) refuse_stops(d);
  bench.nmt(0x80);
}

TEST(StopAssurance, AResetGivesNoHeartbeatToADriveThatRefusesItsStop) {
  for (const int ms : {220, 260, 400}) {
    Driving bench;
    take_from_bridge(bench);
    bench.run_with_watchdogs(milliseconds(ms));
    bench.profile.reset_fault();
    bench.run_with_watchdogs(milliseconds(1200));
    EXPECT_TRUE(bench.stands()) << ms;
    EXPECT_THAT(bench.reason(), HasSubstr("heartbeat and setpoints are withheld")) << ms;
  }
}

TEST(StopAssurance, AfterAResetADriveThatObeysIsNoLongerOneOfThoseWithoutHeartbeat) {
  Driving bench;
  refuse_stops(bench.right());
  bench.nmt(0x80);
  bench.run(milliseconds(220));
  bench.profile.reset_fault();
  bench.run(milliseconds(600));
  EXPECT_THAT(bench.reason(), HasSubstr("; right drive (node 2): stop not confirmed"));
}

TEST(StopAssurance, ABridgeThatHasJustStartedGivesNoHeartbeatToADriveThatRefusesItsStop) {
  Driving before;
  take_from_bridge(before);
  Watched bench;
  bench.drives = before.drives;
  bench.profile.start(bench.now);
  bench.run_with_watchdogs(milliseconds(1500));
  EXPECT_TRUE(bench.stands());
}

TEST(StopAssurance, ANmtCommandOfAnotherIsAnsweredByAQuickStopBySdoInTheNextCycle) {
  Driving bench;
  bench.nmt(0x80);
  bench.cycle();
  EXPECT_THAT(bench.sent, ::testing::Contains(kSdoQuickStop));
  EXPECT_EQ(bench.reason(), "another sender uses 0x000: only one master may command");
  EXPECT_TRUE(bench.run_until([&] { return bench.stands(); }, milliseconds(300)));
  EXPECT_TRUE(bench.snapshot().in_doubt) << "no report yet";
  EXPECT_TRUE(bench.run_until([&] { return bench.off(); }, milliseconds(400)));
  bench.run(milliseconds(200));
  EXPECT_FALSE(bench.snapshot().in_doubt);
  EXPECT_EQ(bench.count(kSdoQuickStop), 1) << "it was obeyed at once";
  EXPECT_EQ(bench.count(kSdoPowerOff), 1);
  EXPECT_EQ(bench.profile.counters().stops_by_sdo, 4);
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 0);
  EXPECT_EQ(bench.newest(canopen::kNmt), nullptr) << "SDO is enough";
  // All is known: nothing more is asked.
  bench.log.clear();
  bench.run(milliseconds(400));
  EXPECT_EQ(bench.newest(0x601), nullptr);
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
}

TEST(StopAssurance, ADriveThatAnotherSwitchesOnBySdoAfterItsStopIsStoppedAgain) {
  Driving bench;
  bench.nmt(0x80);
  ASSERT_TRUE(bench.run_until([&] { return bench.off() && !bench.snapshot().in_doubt; },
                              milliseconds(1000)));
  for (const std::uint8_t word : {0x06, 0x07, 0x0F}) {
    const CanFrame write = CanFrame::make(0x601, {0x2B, 0x40, 0x60, 0, word, 0, 0, 0});
    std::vector<CanFrame> ignored;
    bench.left().on_frame(write, ignored);
    bench.deliver(write);
    bench.cycle();
  }
  bench.left_axis().speed = 100;
  EXPECT_TRUE(bench.snapshot().in_doubt);
  bench.log.clear();
  EXPECT_TRUE(bench.run_until([&] { return bench.count(kSdoQuickStop) > 0; }, milliseconds(60)));
  while (bench.left_axis().speed != 0) {
    bench.cycle();
    ASSERT_EQ(bench.count(kSdoPowerOff), 0);
  }
  EXPECT_TRUE(bench.run_until([&] { return bench.off(); }, milliseconds(1000)));
}

TEST(StopAssurance, OnlyTheNodeThatAnNmtCommandIsForIsStoppedBySdo) {
  const CanFrame start = CanFrame::make(canopen::kNmt, {0x01, 0}),
                 not_ours = CanFrame::make(canopen::kNmt, {0x80, 5}),
                 too_short = CanFrame::make(canopen::kNmt, {0x80}),
                 right = CanFrame::make(canopen::kNmt, {0x80, 2});
  for (const CanFrame& frame : {start, not_ours, too_short, right}) {
    Driving bench;
    bench.deliver(frame);
    bench.cycle();
    EXPECT_EQ(bench.phase(), DrivePhase::faulted) << "whatever it says";
    EXPECT_EQ(bench.newest(0x601), nullptr);
    EXPECT_EQ(bench.newest(0x602) != nullptr, frame == right);
    EXPECT_TRUE(bench.run_until([&] { return bench.stands(); }, milliseconds(300)));
  }
}

TEST(StopAssurance, EachStopIsJudgedAgain) {
  Driving bench;
  for (int i = 0; i < 2; ++i) {
    bench.profile.stop(StopKind::quick);
    ASSERT_TRUE(bench.reach(DrivePhase::standby, milliseconds(1000))) << bench.reason();
    bench.profile.enable();
    ASSERT_TRUE(bench.reach(DrivePhase::enabled, milliseconds(1500))) << bench.reason();
    bench.profile.set_command({1.0, 0.0});
    bench.run(milliseconds(600));
  }
  EXPECT_EQ(bench.profile.counters().stops_by_sdo, 0) << "healthy drives need none";
  for (FakeDrive& d : bench.drives) d.aborts[{0x6040, 0}] = 0x06020000;
  bench.nmt(0x80);
  bench.run(milliseconds(200));
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 0);
  bench.cycle();
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 1);
}

TEST(StopAssurance, ADriveThatIsSwitchedOnAgainDuringItsStopHasNotConfirmedItAnyLonger) {
  Driving bench;
  bench.left_axis().ramp = 1;
  bench.profile.stop(StopKind::quick);
  bench.run(milliseconds(300));
  ASSERT_EQ(bench.left_axis().state, DriveState::quick_stop_active);
  bench.left().set_object(0x1400, 1, 0x80000201);
  bench.left().set_object(0x6040, 0, 0x000F);
  bench.left().aborts[{0x6040, 0}] = 0x06020000;
  bench.left_axis().state = DriveState::operation_enabled;
  bench.run(milliseconds(60));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 1);
}

TEST(StopAssurance, DrivesWithSlowerFeedbackGetTwiceItsTimeToConfirm) {
  for (const auto& [feedback_ms, limit_ms] : {std::pair{60, 200}, std::pair{160, 320}}) {
    Cia402Config config = two_nodes();
    config.feedback_timeout_ms = static_cast<std::uint16_t>(feedback_ms);
    Driving bench(config);
    for (FakeDrive& d : bench.drives) d.aborts[{0x6040, 0}] = 0x06020000;
    bench.nmt(0x80);
    bench.run(milliseconds(limit_ms));
    EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 0);
    bench.cycle();
    EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 1);
    EXPECT_THAT(bench.reason(), HasSubstr(fmt::format("not confirmed within {} ms", limit_ms)));
  }
}

TEST(StopAssurance, ADriveThatLeavesOperationalByItselfIsStoppedBySdo) {
  Driving bench;
  bench.left().nmt = NmtState::pre_operational;
  ASSERT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(140)));
  EXPECT_TRUE(bench.run_until([&] { return bench.stands(); }, milliseconds(300)));
  EXPECT_EQ(bench.count(CanFrame::make(0x602, {0x2B, 0x40, 0x60, 0, 0x02, 0, 0, 0})), 0)
      << "the right one is stopped by PDO";
}

TEST(StopAssurance, ALostQuickStopIsSentAgainAfter50Ms) {
  Driving bench;
  bench.left().lost_replies = 2;
  bench.nmt(0x80);
  bench.run(milliseconds(140));
  EXPECT_EQ(bench.count(kSdoQuickStop), 3);
}

TEST(StopAssurance, AQuickStopThatIsNotObeyedIsWrittenInEachRound) {
  Driving bench;
  bench.left().clamps[{0x6041, 0}] = 0x0237;
  bench.nmt(0x80);
  bench.run(milliseconds(600));
  EXPECT_GT(bench.count(kSdoQuickStop), 3);
}

TEST(StopAssurance, WithoutConfirmationHeartbeatSyncAndSetpointsAreWithheldAfter200Ms) {
  Driving bench;
  for (FakeDrive& d : bench.drives) d.aborts[{0x6040, 0}] = 0x06020000;
  bench.nmt(0x80);
  bench.run_with_watchdogs(milliseconds(200));
  EXPECT_NE(bench.newest(0x77F), nullptr);
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 0);
  bench.log.clear();
  bench.run_with_watchdogs(milliseconds(200));
  EXPECT_GT(bench.left_axis().speed, 50);
  for (const std::uint32_t id : {0x77F, 0x080, 0x201, 0x202}) {
    EXPECT_EQ(bench.newest(id), nullptr) << std::hex << id;
  }
  EXPECT_NE(bench.newest(0x601), nullptr) << "the quick stop is still tried";
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 1);
  EXPECT_THAT(
      bench.reason(),
      HasSubstr("; left drive (node 1), right drive (node 2): stop not confirmed within 200 "
                "ms: heartbeat and setpoints are withheld"));
  bench.run_with_watchdogs(milliseconds(400));
  EXPECT_TRUE(bench.stands());
  // The drives say that they have stopped.
  EXPECT_NE(bench.newest(0x77F), nullptr);
  EXPECT_THAT(bench.reason(), Not(HasSubstr("withheld")));
}

TEST(StopAssurance, ADriveThatSaysNothingGetsNoHeartbeatAndTheOtherStillItsSetpoints) {
  Driving bench;
  bench.right().silent = true;
  ASSERT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(140)));
  bench.run(milliseconds(220));
  bench.log.clear();
  bench.run(milliseconds(100));
  EXPECT_EQ(bench.newest(0x77F), nullptr);
  EXPECT_EQ(bench.newest(0x202), nullptr);
  EXPECT_EQ(bench.count_setpoints(0x201), 5);
}

TEST(StopAssurance, AnOperationalDriveThatIgnoresItsRpdosIsStoppedBySdo) {
  Driving bench;
  bench.left().set_object(0x1400, 1, 0x80000201);  // its RPDO is off
  bench.profile.stop(StopKind::quick);
  bench.run(milliseconds(100));
  EXPECT_EQ(bench.count(kSdoQuickStop), 0);
  bench.cycle();
  EXPECT_EQ(bench.count(kSdoQuickStop), 1);
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(600))) << bench.reason();
  EXPECT_TRUE(bench.stands());
}

TEST(StopAssurance, AStopThatIsNotConfirmedIsAFaultThatNeedsARestart) {
  Driving bench;
  bench.left().set_object(0x1400, 1, 0x80000201);
  bench.left().aborts[{0x6040, 0}] = 0x06020000;
  bench.profile.stop(StopKind::quick);
  bench.run(milliseconds(200));
  EXPECT_EQ(bench.phase(), DrivePhase::stopping);
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): does not confirm its stop"));
  bench.left().aborts.clear();
  const int resets = bench.left().resets;
  bench.run(milliseconds(1000));
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.left().resets, resets + 1);
}

TEST(StopAssurance, ADriveInNmtStoppedIsCommandedToPreOperationalAndStoppedBySdo) {
  Driving bench;
  bench.nmt(0x02);
  bench.cycle();
  EXPECT_EQ(bench.count(CanFrame::make(0x000, {0x80, 1})), 1);
  EXPECT_EQ(bench.count(CanFrame::make(0x000, {0x80, 2})), 1);
  EXPECT_TRUE(bench.run_until([&] { return bench.stands(); }, milliseconds(300)));
  EXPECT_EQ(bench.count(CanFrame::make(0x000, {0x80, 1})), 1);
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 0);
}

TEST(StopAssurance, NmtStoppedDrivesAreCalledBackEvery100MsAndOthersNever) {
  Driving bench;
  bench.left().send_feedback = false;
  bench.left().nmt = NmtState::stopped;
  for (int i = 0; i < 50; ++i) {
    bench.cycle();
    bench.left().nmt = NmtState::stopped;  // another master insists
  }
  // Its heartbeat tells within 100 ms.
  EXPECT_NEAR(bench.count(CanFrame::make(0x000, {0x80, 1})), 9, 1);
  EXPECT_EQ(bench.count(CanFrame::make(0x000, {0x80, 2})), 0);
}

TEST(StopAssurance, ADriveWithAVendorsWatchdogGetsNoSdoEitherForAsLongAsThatTakes) {
  Cia402Config config = two_nodes();
  for (WatchdogConfig& w : config.watchdogs) {
    w.kind = WatchdogConfig::Kind::milliseconds;
    w.object = {0x2000, 0, 2, false};
  }
  Driving bench(config);
  for (FakeDrive& d : bench.drives) d.aborts[{0x6040, 0}] = 0x06020000;
  bench.nmt(0x80);
  bench.run(milliseconds(220));
  bench.log.clear();
  bench.run(milliseconds(340));
  EXPECT_TRUE(bench.log.empty()) << bench.log.size();
  bench.run(milliseconds(20));
  EXPECT_NE(bench.newest(0x601), nullptr);
}

TEST(StopAssurance, DrivesThatStandWithPowerOffAreLeftAlone) {
  Bench bench;
  bench.to_standby();
  bench.log.clear();
  bench.deliver(CanFrame::make(canopen::kNmt, {0x80, 0}));
  for (FakeDrive& d : bench.drives) d.nmt = NmtState::pre_operational;
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.newest(0x601), nullptr);
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 0);
  EXPECT_FALSE(bench.snapshot().in_doubt);
}

TEST(StopAssurance, AStandstillIsSwitchedOffBySdoOnlyOnceItIsBelieved) {
  Driving bench;
  bench.profile.distrust_standstill(bench.now + milliseconds(1500));
  bench.nmt(0x80);
  bench.run(milliseconds(1480));
  EXPECT_TRUE(bench.stands());
  EXPECT_EQ(bench.count(kSdoPowerOff), 0);
  EXPECT_TRUE(bench.snapshot().in_doubt);
  bench.run(milliseconds(120));
  EXPECT_EQ(bench.count(kSdoPowerOff), 1);
  EXPECT_TRUE(bench.off());
}

TEST(StopAssurance, ADriveThatWasLostAtSpeedGetsNoHeartbeatUntilItIsReset) {
  Driving bench;
  bench.right().silent = true;
  ASSERT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(140)));
  bench.run(milliseconds(400));
  bench.profile.reset_fault();
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  bench.log.clear();
  bench.run(milliseconds(1900));
  EXPECT_EQ(bench.newest(0x77F), nullptr);
  EXPECT_TRUE(bench.snapshot().in_doubt);
  bench.run(milliseconds(300));
  EXPECT_NE(bench.newest(0x77F), nullptr);
}

TEST(StopAssurance, ARefusedDriveThatStillTurnsIsStoppedBySdoForAsLongAsItDoes) {
  Driving before;
  Bench bench;
  bench.drives = before.drives;
  for (FakeDrive& d : bench.drives) {
    d.nmt = NmtState::pre_operational;
    d.aborts[{0x6040, 0}] = 0x08000022;  // not now
  }
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(6000)));
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): still turns at"));
  EXPECT_TRUE(bench.snapshot().in_doubt);
  bench.run(milliseconds(300));
  EXPECT_EQ(bench.profile.counters().heartbeat_withheld, 1);
  for (FakeDrive& d : bench.drives) d.aborts.clear();
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.phase(), DrivePhase::refused);
  EXPECT_EQ(bench.left_axis().speed, 0);
  EXPECT_EQ(bench.right_axis().state, DriveState::switch_on_disabled);
  EXPECT_FALSE(bench.snapshot().in_doubt);
  bench.log.clear();
  bench.run(milliseconds(200));
  EXPECT_NE(bench.newest(0x77F), nullptr);
  EXPECT_EQ(bench.newest(0x601), nullptr);
}

TEST(StopAssurance, ARunningDriveThatIsNotOperationalIsStoppedBySdoBeforeItIsReset) {
  Driving before;
  Bench bench;
  bench.drives = before.drives;
  for (FakeDrive& d : bench.drives) {
    d.nmt = NmtState::pre_operational;
    d.beat = false;  // and nothing is heard of it
    d.resets = 0;
    d.fastest_reset = 0;
  }
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets > 0; }, milliseconds(3000)));
  for (FakeDrive& d : bench.drives) d.beat = true;
  ASSERT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.count(kSdoQuickStop), 1);
  EXPECT_EQ(bench.profile.counters().stops_by_sdo,
            bench.count(kSdoQuickStop) +
                bench.count(CanFrame::make(0x602, {0x2B, 0x40, 0x60, 0, 0x02, 0, 0, 0})) +
                bench.count(kSdoPowerOff) +
                bench.count(CanFrame::make(0x602, {0x2B, 0x40, 0x60, 0, 0, 0, 0, 0})));
  for (const FakeDrive& d : bench.drives) {
    EXPECT_EQ(d.resets, 1);
    EXPECT_EQ(d.fastest_reset, 0);
  }
}

/// A new bridge, with a left drive that coasts in NMT "stopped" and sends no heartbeat.
struct Unheard : Bench {
  explicit Unheard(const Cia402Config& config = two_nodes()) : Bench(config) {
    Driving before(config);
    drives = before.drives;
    FakeDrive& drive = left();
    drive.nmt = NmtState::stopped;
    drive.beat = false;
    drive.resets = 0;
    drive.fastest_reset = 0;
    drive.axes[0].ramp = 1;  // brakes hardly
    profile.start(now);
  }
  long recalls(std::uint8_t node) const {
    return count(CanFrame::make(canopen::kNmt, {0x80, node}));
  }
};

TEST(StopAssurance, ADriveThatTurnsInNmtStoppedWithoutAHeartbeatIsRecalledAndNotReset) {
  Unheard bench;
  // After its first request, which has no answer in 500 ms.
  ASSERT_TRUE(bench.run_until([&] { return bench.left().nmt == NmtState::pre_operational; },
                              milliseconds(700)));
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.left().resets, 0);
  EXPECT_THAT(bench.left_axis().speed, ::testing::Gt(0));
  EXPECT_EQ(bench.recalls(1), 1) << "it has answered";
  EXPECT_EQ(bench.recalls(2), 0) << "it was heard";
  bench.left().beat = true;
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets > 0; }, milliseconds(10000)));
  EXPECT_EQ(bench.left().fastest_reset, 0);
}

TEST(StopAssurance, SilenceCountsOnlyAfterARequestThatFollowsTheRecall) {
  Cia402Config config = two_nodes();
  config.sdo_retries = 0;
  Unheard bench(config);
  bench.sdo_delay = milliseconds(300);  // it is slow after the recall
  bench.slow_node = 1;
  ASSERT_TRUE(bench.run_until([&] { return bench.left().nmt == NmtState::pre_operational; },
                              milliseconds(700)));
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.left().resets, 0);
  bench.sdo_delay = milliseconds(0);
  bench.left().beat = true;
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets > 0; }, milliseconds(10000)));
  EXPECT_EQ(bench.left().fastest_reset, 0);
}

TEST(StopAssurance, TheRecallOfADriveThatIsAbsentTakesNoTimeOfItsOwn) {
  Bench bench;
  bench.left().silent = true;
  bench.profile.start(bench.now);
  const CanFrame recall = CanFrame::make(canopen::kNmt, {0x80, 1});
  // It is listened for 150 ms, then asked three times, and once more for 100 ms.
  bench.run(milliseconds(600));
  EXPECT_EQ(bench.count(recall), 0);
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets > 0; }, milliseconds(1200)));
  // Each 100 ms, for a frame may be lost.
  EXPECT_THAT(bench.count(recall), ::testing::AllOf(::testing::Ge(10), ::testing::Le(12)));
}

TEST(StopAssurance, ARunningDriveThatAnswersNoSdoIsNotTakenOutOfOperation) {
  Driving before;
  Bench bench;
  bench.drives = before.drives;
  bench.left().unanswered = FakeDrive::Key{0x6041, 0};
  bench.profile.start(bench.now);
  bench.run(milliseconds(3000));
  EXPECT_EQ(bench.left().nmt, NmtState::operational);
  EXPECT_EQ(bench.count(CanFrame::make(canopen::kNmt, {0x80, 1})), 0);
}

TEST(StopAssurance, ADriveThatDidNotBootIsRecalledBeforeItIsResetAgain) {
  for (const int retries : {0, 2}) {
    Cia402Config config = two_nodes();
    config.sdo_retries = retries;
    Unheard bench(config);
    FakeDrive& left = bench.left();
    left.axes[0].ramp = 1000;
    left.boots = false;
    ASSERT_TRUE(bench.run_until([&] { return left.resets == 1; }, milliseconds(5000)));
    EXPECT_EQ(left.fastest_reset, 0);
    left.nmt = NmtState::stopped;  // by another, who is not heard
    left.axes[0].speed = 100;
    left.axes[0].ramp = 0;
    ASSERT_TRUE(
        bench.run_until([&] { return left.nmt == NmtState::pre_operational; }, milliseconds(5000)));
    bench.run(milliseconds(5000));
    EXPECT_EQ(left.resets, 1) << retries;
    left.axes[0].ramp = 10;
    ASSERT_TRUE(bench.run_until([&] { return left.resets == 2; }, milliseconds(5000)));
    EXPECT_EQ(left.fastest_reset, 0);
  }
}

}  // namespace
}  // namespace tether
