#include "can_bridge/cia402/profile.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "common/vehicle/diff_drive.hpp"
#include "tests/can_bridge/cia402/bench.hpp"

// Restart, enabling and driving of healthy drives; their feedback.
namespace tether {
namespace {

using canopen::DriveState;
using test::Bench;
using test::milliseconds;
using test::two_nodes;

std::vector<std::uint32_t> ids(const std::vector<CanFrame>& frames) {
  std::vector<std::uint32_t> result;
  for (const CanFrame& f : frames) result.push_back(f.id);
  return result;
}

/// The values of the controlword in all RPDOs with this identifier, without repetitions.
std::vector<int> controlwords(const Bench& bench, std::uint32_t id) {
  std::vector<int> words;
  for (const CanFrame& f : bench.log) {
    if (f.id != id) continue;
    const int word = f.data[0] | f.data[1] << 8;
    if (words.empty() || words.back() != word) words.push_back(word);
  }
  return words;
}

// ---------------------------------------------------------------------------- restart

TEST(Cia402Profile, NothingLeavesBeforeStart) {
  Bench bench;
  bench.run(milliseconds(500));
  EXPECT_TRUE(bench.log.empty());
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  EXPECT_FALSE(bench.snapshot().wheels[0].valid);
}

TEST(Cia402Profile, DrivesThatAreRunningAtTheStartAreBrakedBeforeTheyAreReset) {
  Bench first;
  first.drive({1.0, 0.0});
  ASSERT_GT(first.left_axis().speed, 50);
  // The bridge's program is restarted; the drives go on.
  Bench bench;
  bench.drives = first.drives;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.newest(0x201) != nullptr; }, milliseconds(200)));
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  EXPECT_EQ(bench.controlword(0x202), 0x0002);
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets > first.left().resets; }));
  EXPECT_EQ(first.left_axis().state, DriveState::operation_enabled);
  for (const CanFrame& f : bench.log) {
    if (f.id == 0x201 || f.id == 0x202) {
      EXPECT_EQ(canopen::read_integer(f.data.data() + 2, 4, true), 0);
    }
  }
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
}

TEST(Cia402Profile, DrivesThatAreRunningAreResetOnlyOnceTheyStand) {
  Bench first;
  first.drive({1.0, 0.0});
  Bench bench;
  bench.drives = first.drives;
  bench.profile.start(bench.now);
  std::int64_t speed_before_reset = 999;
  while (bench.left().resets == first.left().resets && bench.now < Instant{milliseconds(5000)}) {
    speed_before_reset = bench.left_axis().speed;
    bench.cycle();
  }
  EXPECT_EQ(speed_before_reset, 0);
}

TEST(Cia402Profile, FeedbackAloneShowsThatADriveIsRunning) {
  Bench bench;
  bench.profile.start(bench.now);
  bench.cycle();
  bench.deliver(CanFrame::make(0x181, {0x37, 0x02, 0x40, 0, 0, 0}));
  bench.cycle();
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  EXPECT_EQ(bench.left().resets, 0);
}

TEST(Cia402Profile, ANewStartForgetsTheOldFeedback) {
  Bench bench;
  bench.drive({1.0, 0.0});
  const int resets = bench.left().resets;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets > resets; }));
  EXPECT_FALSE(bench.snapshot().wheels[0].valid);
  EXPECT_EQ(bench.snapshot().wheels[0].state, "unknown");
  EXPECT_FALSE(bench.snapshot().standstill);
}

TEST(Cia402Profile, StandbyWaitsUntilThePowerStagesAreOff) {
  Bench bench;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.newest(0x201) != nullptr; }));
  bench.left().send_feedback = false;
  for (int i = 0; i < 50; ++i) {
    bench.deliver(CanFrame::make(0x181, {0x33, 0x02, 0, 0, 0, 0}));
    bench.deliver(CanFrame::make(0x281, {0, 0, 0, 0, 0, 0, 3}));
    bench.cycle();
  }
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): in SwitchedOn, waiting until its power stage is off");
  bench.left().send_feedback = true;
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(100)));
}

TEST(Cia402Profile, StandbyWaitsUntilTheWheelsStand) {
  Bench bench;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return bench.newest(0x201) != nullptr; }));
  bench.left_axis().ramp = 0;  // pushed: turns on
  bench.left_axis().speed = 20;
  bench.run(milliseconds(3000));
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  EXPECT_EQ(bench.reason(), "left drive (node 1): waiting until its wheel stands");
  bench.left_axis().speed = 0;
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(100)));
}

TEST(Cia402Profile, StartWhileDrivingBrakesFirst) {
  Bench bench;
  bench.drive({1.0, 0.0});
  const int resets = bench.left().resets;
  bench.profile.start(bench.now);
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  EXPECT_EQ(bench.controlword(), 0x0002);
  EXPECT_EQ(bench.target(), 0);
  ASSERT_TRUE(bench.run_until([&] { return bench.left().resets > resets; }));
  EXPECT_EQ(bench.left_axis().speed, 0);
  EXPECT_TRUE(bench.reach(DrivePhase::standby));
}

// ---------------------------------------------------------------------------- enabling

TEST(Cia402Profile, EnablesStepByStepWithZeroTarget) {
  Bench bench;
  bench.to_standby();
  bench.enable_verified();
  bench.log.clear();
  bench.profile.set_command({1.0, 0.0});
  EXPECT_EQ(bench.phase(), DrivePhase::enabling);
  ASSERT_TRUE(bench.reach(DrivePhase::enabled, milliseconds(200)));
  EXPECT_THAT(controlwords(bench, 0x201), ::testing::ElementsAre(0x06, 0x07, 0x0F));
  EXPECT_THAT(controlwords(bench, 0x202), ::testing::ElementsAre(0x06, 0x07, 0x0F));
  bench.run(milliseconds(100));
  for (const CanFrame& f : bench.log) {
    if (f.id == 0x201 || f.id == 0x202) {
      EXPECT_EQ(canopen::read_integer(f.data.data() + 2, 4, true), 0);
    }
  }
}

TEST(Cia402Profile, IsEnabledOnlyWhenBothAxesAre) {
  Bench bench;
  bench.to_standby();
  bench.enable_verified();
  bench.right_axis().stuck_below = DriveState::switched_on;
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.left_axis().state, DriveState::operation_enabled);
  EXPECT_EQ(bench.phase(), DrivePhase::enabling);
  bench.right_axis().stuck_below.reset();
  EXPECT_TRUE(bench.reach(DrivePhase::enabled, milliseconds(100)));
}

TEST(Cia402Profile, AStepThatTakesTooLongFaultsWithWhatToCheck) {
  Bench bench;
  bench.to_standby();
  bench.right_axis().stuck_below = DriveState::ready_to_switch_on;
  bench.profile.enable();
  ASSERT_TRUE(bench.run_until([&] { return bench.phase() != DrivePhase::enabling; }));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): is still in ReadyToSwitchOn after controlword 0x0007 for 1000 "
            "ms: check its main supply, STO and enable inputs");
  bench.run(milliseconds(200));
  EXPECT_EQ(bench.left_axis().state, DriveState::switch_on_disabled);
}

TEST(Cia402Profile, AnOldStatuswordConfirmsNoStep) {
  Bench bench;
  bench.to_standby();
  bench.enable_verified();
  bench.left().send_feedback = false;  // no statusword after the controlword
  bench.cycle();
  bench.cycle();
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x201), 0x0006);
  EXPECT_EQ(bench.controlword(0x202), 0x000F);
  EXPECT_EQ(bench.phase(), DrivePhase::enabling) << bench.reason();
}

TEST(Cia402Profile, AStepsTimeBeginsWithEnable) {
  Bench bench;
  bench.to_standby();
  bench.left().send_feedback = false;
  bench.deliver(CanFrame::make(0x181, {0x00, 0x02, 0, 0, 0, 0}));  // NotReadyToSwitchOn
  bench.profile.enable();
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::enabling);
}

TEST(Cia402Profile, EnableActsInStandbyOnly) {
  Bench bench;
  bench.profile.start(bench.now);
  bench.cycle();
  bench.profile.enable();
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  ASSERT_TRUE(bench.reach(DrivePhase::standby));
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.phase(), DrivePhase::standby);  // not remembered
}

// ---------------------------------------------------------------------------- driving

TEST(Cia402Profile, TurnsATwistIntoBothWheelsSpeedsWithSignAndRounding) {
  Bench bench;
  bench.drive({0.5, 0.3});
  const WheelSpeeds w = to_wheel_speeds({0.5, 0.3}, Bench::kTrack_m);
  const double rpm_per_mps = 60.0 / (2.0 * std::numbers::pi * Bench::kRadius_m);
  EXPECT_EQ(bench.target(0x201), std::llround(w.left_mps * rpm_per_mps));    // 41
  EXPECT_EQ(bench.target(0x202), -std::llround(w.right_mps * rpm_per_mps));  // mounted reversed
  EXPECT_EQ(bench.target(0x201), 41);
  EXPECT_EQ(bench.target(0x202), -55);
  EXPECT_NEAR(bench.snapshot().wheels[0].speed_radps, w.left_mps / Bench::kRadius_m, 0.1);
  EXPECT_NEAR(bench.snapshot().wheels[1].speed_radps, w.right_mps / Bench::kRadius_m, 0.1);
  EXPECT_GT(bench.snapshot().wheels[1].angle_rad, 0.0);
  EXPECT_FALSE(bench.snapshot().standstill);
}

TEST(Cia402Profile, SendsSetpointsThenSyncThenTheHeartbeatAsDue) {
  Bench bench;
  bench.to_enabled();
  ASSERT_TRUE(bench.run_until([&] { return bench.sent.back().id == 0x77F; }));
  EXPECT_THAT(ids(bench.sent), ::testing::ElementsAre(0x201, 0x202, 0x080, 0x77F));
  bench.cycle();
  EXPECT_THAT(ids(bench.sent), ::testing::ElementsAre(0x201, 0x202, 0x080));
  bench.cycle();
  EXPECT_THAT(ids(bench.sent), ::testing::ElementsAre(0x201, 0x202, 0x080));
  bench.cycle();
  EXPECT_THAT(ids(bench.sent), ::testing::ElementsAre(0x201, 0x202, 0x080, 0x77F));
}

TEST(Cia402Profile, TheHeartbeatIntervalIsRoundedUpToControlCycles) {
  Cia402Config config = two_nodes();
  config.heartbeat_ms = 50;
  Bench bench(config);
  bench.to_enabled();
  bench.log.clear();
  bench.run(milliseconds(6000));
  EXPECT_EQ(bench.count(CanFrame::make(0x77F, {0x05})), 100);  // 60 ms
}

TEST(Cia402Profile, ATickThatComesALittleEarlyStillSendsTheHeartbeat) {
  Bench bench;
  std::vector<CanFrame> out;
  bench.profile.start(bench.now);
  bench.profile.tick(Instant{milliseconds(0)}, out);
  EXPECT_EQ(out.size(), 1u);
  bench.profile.tick(Instant{milliseconds(59)} - Duration{1}, out);
  EXPECT_EQ(out.size(), 1u);
  bench.profile.tick(Instant{milliseconds(59)}, out);
  EXPECT_EQ(out.size(), 2u);
}

TEST(Cia402Profile, SaturationScalesBothWheels) {
  Cia402Config config = two_nodes();
  for (AxisConfig& a : config.axes) {
    a.target_velocity = {0x60FF, 0, 2, true};
    a.target_velocity_per_rps = {6000, 1};
  }
  for (PdoConfig& p : config.pdos) {
    if (!p.transmit) p.objects[1].bytes = 2;
  }
  Bench bench(config);
  bench.to_enabled();
  bench.profile.set_command({10.0, 20.0});  // left 5 m/s, right 15 m/s
  bench.cycle();
  const CanFrame left = *bench.newest(0x201), right = *bench.newest(0x202);
  EXPECT_EQ(canopen::read_integer(left.data.data() + 2, 2, true), 10922);
  EXPECT_EQ(canopen::read_integer(right.data.data() + 2, 2, true), -32767);
}

TEST(Cia402Profile, ATwistThatIsNotUsableIsZero) {
  Bench bench;
  bench.drive({0.5, 0.0});
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL, 1e12}) {
    bench.profile.set_command({0.5, 0.0});
    bench.cycle();
    EXPECT_EQ(bench.target(0x201), 48);
    bench.profile.set_command({bad, 0.0});
    bench.cycle();
    EXPECT_EQ(bench.target(0x201), 0);
    EXPECT_EQ(bench.target(0x202), 0);
    bench.profile.set_command({0.5, bad});
    bench.cycle();
    EXPECT_EQ(bench.target(0x201), 0);
    EXPECT_EQ(bench.target(0x202), 0);
  }
}

TEST(Cia402Profile, ACommandGivenBeforeEnabledIsForgotten) {
  Bench bench;
  bench.to_standby();
  bench.profile.enable();
  bench.profile.set_command({1.0, 0.0});
  ASSERT_TRUE(bench.reach(DrivePhase::enabled));
  bench.run(milliseconds(100));
  EXPECT_EQ(bench.target(0x201), 0);
}

// ---------------------------------------------------------------------------- feedback

TEST(Cia402Profile, ReportsTheDrivesStateAndEncoder) {
  Bench bench;
  bench.drive({1.0, 0.0}, milliseconds(1000));
  const DrivetrainSnapshot s = bench.snapshot();
  EXPECT_TRUE(s.feedback_fresh);
  EXPECT_TRUE(s.wheels[0].valid);
  EXPECT_EQ(s.wheels[0].state, "OperationEnabled");
  EXPECT_EQ(s.wheels[0].statusword, 0x0237u);
  EXPECT_EQ(s.wheels[0].position_counts, bench.left_axis().position);
  EXPECT_EQ(s.wheels[1].position_counts, -bench.right_axis().position);
  EXPECT_NEAR(s.wheels[0].angle_rad,
              static_cast<double>(bench.left_axis().position) / 4096 * 2 * std::numbers::pi, 1e-9);
}

TEST(Cia402Profile, StandstillNeedsFreshFeedbackOfBothWheels) {
  Bench bench;
  bench.to_standby();
  ASSERT_TRUE(bench.snapshot().standstill);
  const Instant last = bench.now - Bench::kCycle + milliseconds(1);
  EXPECT_TRUE(bench.profile.snapshot(last + milliseconds(99)).standstill);
  EXPECT_FALSE(bench.profile.snapshot(last + milliseconds(100)).standstill);
}

TEST(Cia402Profile, StandstillNeedsTheFreshPositionToo) {
  Bench bench;
  bench.to_standby();
  bench.left().send_feedback = false;
  for (int i = 0; i < 6; ++i) {
    bench.deliver(CanFrame::make(0x181, {0x50, 0x02, 0, 0, 0, 0}));
    bench.cycle();
  }
  EXPECT_FALSE(bench.snapshot().feedback_fresh);
  EXPECT_FALSE(bench.snapshot().standstill);
}

}  // namespace
}  // namespace tether
