#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Standstill takes two witnesses, speed and position: one alone may say zero of a wheel that turns.
namespace tether {
namespace {

using canopen::DriveState;
using canopen::NmtState;
using test::Bench;
using test::FakeDrive;
using test::milliseconds;
using ::testing::HasSubstr;

/// Driving at 1 m/s, with drives whose speed object reads zero whatever the wheel does.
struct SpeedReadsZero : Bench {
  explicit SpeedReadsZero(const Cia402Config& config = test::two_nodes()) : Bench(config) {
    drive({1.0, 0.0}, milliseconds(600));
    for (FakeDrive& d : drives) d.speed_reads = 0;
    run(milliseconds(40));
  }
  bool cut_while_turning() {
    cycle();
    return (controlword(0x201) == 0 && left_axis().speed != 0) ||
           (controlword(0x202) == 0 && right_axis().speed != 0);
  }
};

TEST(TwoWitnesses, AWheelWhoseSpeedReadsZeroKeepsItsPowerUntilItsPositionStandsToo) {
  SpeedReadsZero bench;
  for (FakeDrive& d : bench.drives) d.axes[0].ramp = 2;
  bench.profile.stop(StopKind::quick);
  while (bench.phase() == DrivePhase::stopping) {
    ASSERT_FALSE(bench.cut_while_turning());
    if (bench.left_axis().speed != 0) {
      ASSERT_FALSE(bench.snapshot().standstill);
      ASSERT_TRUE(bench.snapshot().turning);
    }
  }
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
}

TEST(TwoWitnesses, AFaultCutsNoPowerOfAWheelWhoseSpeedReadsZero) {
  SpeedReadsZero bench;
  for (FakeDrive& d : bench.drives) d.axes[0].ramp = 2;
  bench.deliver(test::emergency(1, 0x3210));
  ASSERT_EQ(bench.phase(), DrivePhase::faulted);
  while (bench.left_axis().speed != 0) ASSERT_FALSE(bench.cut_while_turning());
  EXPECT_TRUE(bench.run_until([&] { return bench.controlword(0x201) == 0; }, milliseconds(200)));
}

TEST(TwoWitnesses, AFrozenPositionAloneIsNoStandstillEither) {
  Bench bench;
  bench.drive({1.0, 0.0}, milliseconds(600));
  for (FakeDrive& d : bench.drives) {
    d.position_reads = 1234;
    d.axes[0].ramp = 2;
  }
  bench.run(milliseconds(200));
  bench.profile.stop(StopKind::quick);
  while (bench.left_axis().speed != 0) {
    bench.cycle();
    ASSERT_EQ(bench.controlword(0x201), 0x0002);
  }
}

TEST(TwoWitnesses, WheelsThatCoastWithoutPowerAreNotKnownToStand) {
  SpeedReadsZero bench;
  for (FakeDrive& d : bench.drives) {
    d.axes[0].ramp = 1;
    d.axes[0].state = DriveState::switch_on_disabled;  // state after its own quick stop
  }
  bench.run(milliseconds(300));
  ASSERT_NE(bench.left_axis().speed, 0);
  EXPECT_FALSE(bench.snapshot().standstill);
  EXPECT_TRUE(bench.snapshot().turning);
  EXPECT_TRUE(bench.snapshot().in_doubt);
}

// ---------------------------------------------------------------------------- before a reset

/// A restarted bridge; its drives roll on, pre-operational, without power.
struct Rolls : Bench {
  explicit Rolls(bool operational = false) {
    Bench before;
    before.drive({1.0, 0.0}, milliseconds(1000));
    drives = before.drives;
    for (FakeDrive& d : drives) {
      d.resets = 0;
      d.axes[0].ramp = 0;
      if (!operational) d.nmt = NmtState::pre_operational;
    }
  }
  bool reset() const { return drives.front().resets > 0 || drives.back().resets > 0; }
};

TEST(TwoWitnesses, ASpeedThatIsAbortedIsUnknownAndNotZero) {
  Rolls bench;
  for (FakeDrive& d : bench.drives) d.aborts[{0x606C, 0}] = 0x06020000;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(8000)));
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): still turns at"));
  EXPECT_FALSE(bench.reset());
}

TEST(TwoWitnesses, ASpeedThatReadsZeroResetsNoDriveWhosePositionMoves) {
  Rolls bench;
  for (FakeDrive& d : bench.drives) d.speed_reads = 0;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(8000)));
  EXPECT_FALSE(bench.reset());
  for (FakeDrive& d : bench.drives) d.axes[0].ramp = 10;
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.left().fastest_reset, 0);
}

TEST(TwoWitnesses, FeedbackThatSaysTurningOutweighsAnSdoThatSaysNothing) {
  Rolls bench(true);
  for (FakeDrive& d : bench.drives) {
    d.aborts[{0x606C, 0}] = d.aborts[{0x6064, 0}] = d.aborts[{0x6041, 0}] = 0x06020000;
  }
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(8000)));
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): still turns at"));
  bench.run(milliseconds(2000));
  EXPECT_FALSE(bench.reset());
}

TEST(TwoWitnesses, ASpeedThatWasReadOnceAndIsAbortedThenIsUnknown) {
  Rolls bench;
  for (FakeDrive& d : bench.drives) d.axes[0].speed = 0;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] {
    const CanFrame* f = bench.newest(0x601);
    return f != nullptr && f->data[1] == 0x64;  // the first position is asked for
  }));
  for (FakeDrive& d : bench.drives) d.aborts[{0x606C, 0}] = 0x06020000;
  bench.run(milliseconds(2000));
  EXPECT_FALSE(bench.reset());
}

TEST(TwoWitnesses, AResetWithoutBootUpMessageIsNotRepeatedWhileTheWheelTurns) {
  Rolls bench;
  for (FakeDrive& d : bench.drives) d.axes[0].speed = 0;
  bench.left().boots = false;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets == 1; }));
  bench.left_axis().speed = 20;  // it is pushed
  bench.run(milliseconds(4000));
  EXPECT_EQ(bench.left().resets, 1);
  bench.left_axis().speed = 0;
  bench.left().boots = true;
  EXPECT_TRUE(bench.run_until([&] { return bench.left().resets == 2; }, milliseconds(1000)));
}

TEST(TwoWitnesses, ADriveThatBootsWhileItIsAskedIsAskedAtOnce) {
  Rolls bench;
  for (FakeDrive& d : bench.drives) {
    d.silent = true;
    d.axes[0].speed = 0;
  }
  bench.profile.start(bench.now);
  bench.run(milliseconds(240));
  std::vector<CanFrame> boot;
  for (FakeDrive& d : bench.drives) {
    d.silent = false;
    d.reboot(boot);
  }
  for (const CanFrame& f : boot) bench.deliver(f);
  EXPECT_TRUE(bench.run_until([&] { return bench.reset(); }, milliseconds(260)));
}

TEST(TwoWitnesses, ADriveThatIsHeardAgainIsNotResetByTheSilenceBefore) {
  Rolls bench;
  for (FakeDrive& d : bench.drives) d.silent = true;
  bench.left_axis().speed = 0;
  bench.profile.start(bench.now);
  bench.run(milliseconds(200));
  bench.left().silent = false;  // heard, but it waits for the other
  bench.left_axis().speed = 100;
  bench.run(milliseconds(3000));
  EXPECT_EQ(bench.left().resets, 0);
}

TEST(TwoWitnesses, ADriveThatIsBackBeforeItsSilenceIsKnownIsNotResetWhileItTurns) {
  // Without heartbeat, so that nothing but its answers shows that it is there.
  for (const int slow_ms : {0, 40}) {
    bool absent = false;
    for (int silent_ms = 200; silent_ms <= 4000 && !absent; silent_ms += 20) {
      Rolls bench;
      bench.sdo_delay = milliseconds(slow_ms);
      bench.slow_node = 1;
      bench.left().beat = false;
      bench.left().silent = true;
      bench.right_axis().speed = 0;
      bench.profile.start(bench.now);
      bench.run(milliseconds(silent_ms));
      absent = bench.left().resets > 0;
      bench.left().silent = false;
      bench.run(milliseconds(100));  // how old the last request may be
      if (bench.left().resets > 0) continue;
      bench.run(milliseconds(1000));
      EXPECT_EQ(bench.left().resets, 0) << silent_ms;
    }
    EXPECT_TRUE(absent) << "a drive that stays silent counts as absent at last";
  }
}

TEST(TwoWitnesses, AWatchdogThatIsNotAnsweredSaysNothingOfTheWheel) {
  for (const int speed : {0, 100}) {
    Rolls bench;
    bench.left().beat = false;
    bench.left().unanswered = {0x1016, 1};
    bench.left_axis().speed = speed;
    bench.right_axis().speed = 0;
    bench.profile.start(bench.now);
    ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(8000)));
    EXPECT_EQ(bench.left().resets > 0, speed == 0) << bench.reason();
    EXPECT_THAT(bench.reason(), HasSubstr(speed == 0 ? "no answer" : "still turns"));
  }
}

TEST(TwoWitnesses, ABridgeThatWasSuspendedAsksAgainBeforeItResets) {
  for (int ms = 300;; ms += 20) {
    Rolls bench;
    for (FakeDrive& d : bench.drives) d.axes[0].speed = 0;
    bench.profile.start(bench.now);
    bench.run(milliseconds(ms));
    if (bench.reset()) break;
    ASSERT_LT(ms, 2000);
    bench.now += milliseconds(400);
    bench.left_axis().speed = 100;  // pushed meanwhile
    bench.run(milliseconds(600));
    EXPECT_EQ(bench.left().resets, 0) << ms;
  }
}

TEST(TwoWitnesses, ADriveThatWasSeenToCoastAndFallsSilentIsNotReset) {
  Bench bench;
  bench.drive({1.0, 0.0});
  std::vector<CanFrame> boot;
  bench.left().reboot(boot);  // reset by another's NMT command: it coasts
  bench.left_axis().speed = 100;
  bench.left_axis().ramp = 0;
  for (const CanFrame& f : boot) bench.deliver(f);
  bench.run(milliseconds(400));
  bench.left().resets = bench.right().resets = 0;
  bench.profile.reset_fault();
  bench.run(milliseconds(1000));
  bench.left().silent = true;
  ASSERT_TRUE(bench.reach(DrivePhase::refused, milliseconds(8000)));
  EXPECT_EQ(bench.left().resets, 0);
  EXPECT_THAT(bench.reason(), HasSubstr("left drive (node 1): answers no SDO request"));
  bench.left().silent = false;
  bench.left_axis().speed = 0;
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
}

TEST(TwoWitnesses, ADriveThatStoodWithoutPowerAndFallsSilentIsReset) {
  Bench bench;
  bench.to_standby();
  bench.left().silent = true;
  ASSERT_TRUE(bench.reach(DrivePhase::faulted));
  bench.left().resets = 0;
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.run_until([&] { return bench.left().resets > 0; }));
}

TEST(TwoWitnesses, ADriveThatAnswersWithOneWitnessOnlyIsResetAfterFiveSeconds) {
  Rolls bench;
  for (FakeDrive& d : bench.drives) {
    d.aborts[{0x606C, 0}] = 0x06020000;
    d.axes[0].speed = 0;
  }
  bench.profile.start(bench.now);
  bench.run(milliseconds(4900));
  EXPECT_FALSE(bench.reset());
  bench.run(milliseconds(300));
  EXPECT_TRUE(bench.reset());
}

}  // namespace
}  // namespace tether
