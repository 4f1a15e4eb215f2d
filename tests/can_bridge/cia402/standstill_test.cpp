#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// No drive is reset while its wheel turns: a reset switches its power stage off.
namespace tether {
namespace {

using canopen::DriveState;
using canopen::NmtState;
using test::Bench;
using test::milliseconds;
using ::testing::HasSubstr;

/// A bridge that is restarted while `before`'s drives go on.
struct Restarted : Bench {
  explicit Restarted(const Bench& before) : Bench(before.config) {
    drives = before.drives;
    for (test::FakeDrive& d : drives) d.resets = 0;
  }
  /// Both have lost the bridge's heartbeat and brake.
  void lose_master() {
    for (test::FakeDrive& d : drives) d.nmt = NmtState::pre_operational;
  }
  bool reset() const { return drives.front().resets > 0 || drives.back().resets > 0; }
};

struct Rolling : Bench {
  Rolling() { drive({1.0, 0.0}, milliseconds(1000)); }
};

TEST(Cia402Standstill, DrivesThatBrakeByThemselvesAreResetOnlyOnceTheyStand) {
  Restarted bench{Rolling()};
  bench.lose_master();
  for (test::FakeDrive& d : bench.drives) d.axes[0].ramp = 2;
  bench.profile.start(bench.now);
  bench.run(milliseconds(900));
  EXPECT_GT(bench.left_axis().speed, 0);
  EXPECT_FALSE(bench.reset());
  EXPECT_EQ(bench.newest(0x201), nullptr);  // pre-operational: no PDO would be heard
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.left().fastest_reset, 0);
  EXPECT_EQ(bench.right().fastest_reset, 0);
}

TEST(Cia402Standstill, ADriveThatCoastsInFaultIsResetOnlyOnceItStands) {
  Restarted bench{Rolling()};
  bench.lose_master();
  bench.right_axis().state = DriveState::fault;
  bench.right_axis().error = 0x8130;
  bench.right_axis().ramp = 1;
  bench.profile.start(bench.now);
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.right().fastest_reset, 0);
}

TEST(Cia402Standstill, AResetAfterALostHeartbeatWaitsForTheWheelsToo) {
  Rolling bench;
  const int resets = bench.left().resets;
  for (test::FakeDrive& d : bench.drives) {
    d.nmt = NmtState::pre_operational;
    d.axes[0].ramp = 1;
  }
  ASSERT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(400)));
  ASSERT_GT(bench.left_axis().speed, 0);
  bench.profile.reset_fault();
  bench.run(milliseconds(600));
  EXPECT_EQ(bench.left().resets, resets);
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.left().fastest_reset, 0);
}

TEST(Cia402Standstill, ADriveThatIsHeardAgainIsWaitedForWhenTheOtherStandsAlready) {
  Rolling bench;
  bench.left_axis().ramp = 100;
  bench.right().silent = true;  // its plug is out
  bench.right().nmt = NmtState::pre_operational;
  bench.right_axis().ramp = 1;
  bench.run(milliseconds(500));
  ASSERT_EQ(bench.left_axis().speed, 0);
  ASSERT_LT(bench.right_axis().speed, -50);  // mounted the other way round
  bench.right().silent = false;
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.right().fastest_reset, 0);
}

TEST(Cia402Standstill, AFaultedDriveThatLeftOperationalWaitsForTheOneThatIsStillTurning) {
  Restarted bench{Rolling()};
  bench.left_axis().ramp = 100;
  bench.right().nmt = NmtState::pre_operational;
  bench.right_axis().ramp = 1;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.newest(0x201) != nullptr; }, milliseconds(200)));
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.left().resets, 0);  // both are configured together
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.right().fastest_reset, 0);
}

TEST(Cia402Standstill, ADriveThatDoesNotBrakeIsRefusedAndNeverReset) {
  Restarted bench{Rolling()};
  for (test::FakeDrive& d : bench.drives) d.axes[0].ramp = 0;
  bench.left_axis().speed = 100;
  bench.right_axis().speed = 0;
  bench.profile.start(bench.now);
  bench.run(milliseconds(4900));
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(400)));
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): still turns at 1.05 m/s after 5 s: check its brake and load; no "
            "drive is reset while its wheel may turn, the stop stays commanded");
  bench.log.clear();
  bench.run(milliseconds(5000));
  EXPECT_FALSE(bench.reset());
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  EXPECT_EQ(bench.target(0x201), 0);

  bench.profile.reset_fault();
  ASSERT_TRUE(bench.run_until([&] { return bench.phase() == DrivePhase::refused; }));
  EXPECT_FALSE(bench.reset());

  bench.left_axis().ramp = 10;
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.left().fastest_reset, 0);
}

TEST(Cia402Standstill, TheRefusalNamesEachDriveThatTurns) {
  Restarted bench{Rolling()};
  bench.lose_master();
  for (test::FakeDrive& d : bench.drives) {
    d.axes[0].ramp = 0;
    d.axes[0].state = DriveState::fault;
  }
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): still turns at"));
  EXPECT_THAT(bench.reason(), HasSubstr("; right drive (node 2): still turns at"));
}

TEST(Cia402Standstill, AStandstillThatIsNotToBeBelievedResetsNoDrive) {
  Restarted bench{Rolling()};
  bench.lose_master();
  for (test::FakeDrive& d : bench.drives) d.axes[0].speed = 0;
  bench.profile.distrust_standstill(bench.now + milliseconds(1500));
  bench.profile.start(bench.now);
  bench.run(milliseconds(1480));
  EXPECT_FALSE(bench.reset());
  bench.run(milliseconds(60));
  EXPECT_TRUE(bench.reset());
}

TEST(Cia402Standstill, ADriveThatIsNotHeardIsAskedBeforeItIsReset) {
  Restarted bench{Rolling()};
  bench.lose_master();
  for (test::FakeDrive& d : bench.drives) {
    d.beat = false;
    d.axes[0].ramp = 1;
  }
  bench.profile.start(bench.now);
  bench.run(milliseconds(160));
  EXPECT_EQ(bench.newest(0x601), nullptr);
  bench.run(milliseconds(1000));
  EXPECT_GT(bench.left_axis().speed, 0);
  EXPECT_FALSE(bench.reset());
  ASSERT_TRUE(bench.run_until([&] { return bench.reset(); }));
  EXPECT_EQ(bench.left().fastest_reset, 0);
  EXPECT_EQ(bench.right().fastest_reset, 0);
}

TEST(Cia402Standstill, ARunningDriveThatAnswersNoSdoIsJudgedByItsFeedback) {
  Restarted bench{Rolling()};
  for (test::FakeDrive& d : bench.drives) {
    d.unanswered = {0x6041, 0};
    d.axes[0].ramp = 1;
  }
  bench.profile.start(bench.now);
  bench.run(milliseconds(1500));
  EXPECT_FALSE(bench.reset());
  ASSERT_TRUE(bench.run_until([&] { return bench.reset(); }));
  EXPECT_EQ(bench.left().fastest_reset, 0);
  EXPECT_EQ(bench.right().fastest_reset, 0);

  Restarted stuck{Rolling()};
  stuck.left().unanswered = {0x6041, 0};
  stuck.left_axis().ramp = 0;
  stuck.profile.start(stuck.now);
  ASSERT_TRUE(stuck.reach(DrivePhase::refused));
  EXPECT_THAT(stuck.reason(), HasSubstr("left drive (node 1): still turns at 0.99 m/s"));
  EXPECT_FALSE(stuck.reset());
}

TEST(Cia402Standstill, ADriveThatBeatsAndTellsNothingOfItsWheelIsNotReset) {
  for (const bool operational : {true, false}) {
    Restarted bench{Rolling()};
    if (!operational) bench.lose_master();
    for (test::FakeDrive& d : bench.drives) {
      d.unanswered = {0x6041, 0};
      d.send_feedback = false;
    }
    bench.profile.start(bench.now);
    ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(8000)));
    EXPECT_FALSE(bench.reset());
    EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): answers no SDO request, and no "
                                          "feedback says that its wheel stands"));
    EXPECT_TRUE(!operational || bench.controlword(0x201) == 0x0002);
    for (test::FakeDrive& d : bench.drives) {
      d.unanswered.reset();
      d.send_feedback = true;
    }
    bench.profile.reset_fault();
    EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  }
}

TEST(Cia402Standstill, APowerStageThatIsOnMustStandForHalfASecond) {
  Restarted bench{Rolling()};
  bench.lose_master();
  for (test::FakeDrive& d : bench.drives) {
    d.axes[0].speed = 0;
    d.axes[0].ramp = 0;
    d.axes[0].state = DriveState::switched_on;
  }
  bench.profile.start(bench.now);
  bench.run(milliseconds(600));
  EXPECT_FALSE(bench.reset());
  bench.run(milliseconds(400));
  EXPECT_TRUE(bench.reset());
}

TEST(Cia402Standstill, DrivesThatStandWithPowerOffDelayNothing) {
  Bench before;
  before.to_standby();
  Restarted bench(before);
  bench.lose_master();
  bench.profile.start(bench.now);
  EXPECT_TRUE(bench.run_until([&] { return bench.reset(); }, milliseconds(400)));
}

TEST(Cia402Standstill, AWheelThatIsTurnedBackwardsTurns) {
  Restarted bench{Rolling()};
  bench.lose_master();
  for (test::FakeDrive& d : bench.drives) {
    d.axes[0].ramp = 0;
    d.axes[0].speed = -20;
  }
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): still turns at -0.21 m/s"));
  EXPECT_THAT(bench.reason(), HasSubstr("right drive (node 2): still turns at 0.21 m/s"));
}

TEST(Cia402Standstill, ADriveThatHasJustBootedIsAskedAgain) {
  Restarted bench{Rolling()};
  bench.lose_master();
  bench.left_axis().ramp = 0;
  bench.profile.start(bench.now);
  bench.run(milliseconds(1000));
  ASSERT_FALSE(bench.reset());
  std::vector<CanFrame> boot;
  bench.left().reboot(boot);
  for (const CanFrame& f : boot) bench.deliver(f);
  bench.run(milliseconds(100));
  EXPECT_FALSE(bench.reset()) << "it may roll without power";
  EXPECT_TRUE(bench.run_until([&] { return bench.reset(); }, milliseconds(300)));
}

/// One drive's inquiry, by itself.
struct Inquiry {
  static constexpr std::array<std::uint16_t, 2> kStop{2, 2};

  Bench bench;
  cia402::StandstillInquiry inquiry{bench.config, 1, milliseconds(500)};
  bool cable = true;
  std::size_t asked = 0;

  Inquiry() {
    bench.left().nmt = NmtState::pre_operational;
    inquiry.begin();
  }
  void cycle() {
    std::vector<CanFrame> out, answers;
    inquiry.tick(bench.now, kStop, out);
    asked += out.size();
    if (cable) {
      for (const CanFrame& frame : out) bench.left().on_frame(frame, answers);
    }
    for (const CanFrame& frame : answers) inquiry.on_sdo(frame);
    bench.now += Bench::kCycle;
  }
  void run(milliseconds time) {
    for (milliseconds t{0}; t < time; t += Bench::kCycle) cycle();
  }
};

TEST(Cia402Standstill, ARoundWithARepeatedRequestConfirmsNothing) {
  using Verdict = cia402::StandstillInquiry::Verdict;
  Inquiry node;
  // Without its cable after the speed of its first round was read; its wheel is pushed then.
  for (std::size_t before = 1; before <= 5; ++before) {
    node.inquiry.begin();
    node.cable = true;
    node.bench.left_axis().speed = 0;
    node.run(milliseconds(400));
    ASSERT_EQ(node.inquiry.verdict(), Verdict::standing);
    for (const std::size_t end = node.asked + before; node.asked < end;) node.cycle();
    node.cable = false;
    node.run(milliseconds(300));
    EXPECT_EQ(node.inquiry.verdict(), Verdict::unknown) << "it may only be slow";
    node.bench.left_axis().speed = 100;
    node.run(milliseconds(220));
    node.cable = true;
    for (int cycles = 0; cycles < 6; ++cycles) {
      node.cycle();
      EXPECT_NE(node.inquiry.verdict(), Verdict::standing) << before << ", " << cycles;
    }
  }
}

TEST(Cia402Standstill, StandstillIsBelievedNoLongerThanTheNextSpeedShouldTake) {
  using Verdict = cia402::StandstillInquiry::Verdict;
  Inquiry node;
  node.run(milliseconds(400));
  for (int cycles = 0; cycles < 100; ++cycles, node.cycle()) {
    ASSERT_EQ(node.inquiry.verdict(), Verdict::standing) << "every round takes as long";
  }
  node.cable = false;
  // A round has four questions of a cycle each.
  node.run(5 * Bench::kCycle);
  EXPECT_EQ(node.inquiry.verdict(), Verdict::unknown);
  node.cable = true;
  node.run(milliseconds(1000));
  EXPECT_EQ(node.inquiry.verdict(), Verdict::standing);
}

TEST(Cia402Standstill, TheRoundAfterOneWithARepeatedRequestCounts) {
  using Verdict = cia402::StandstillInquiry::Verdict;
  Inquiry node;
  node.cable = false;
  node.run(milliseconds(480));
  node.cable = true;
  node.run(milliseconds(140));
  EXPECT_EQ(node.inquiry.verdict(), Verdict::unconfirmed);
  node.run(milliseconds(200));
  EXPECT_EQ(node.inquiry.verdict(), Verdict::standing);
}

}  // namespace
}  // namespace tether
