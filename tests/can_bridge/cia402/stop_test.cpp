#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Quick stop and disable of healthy drives; frames that are not what they should be.
namespace tether {
namespace {

using canopen::DriveState;
using test::Bench;
using test::milliseconds;

/// The values of the controlword in all RPDOs with this identifier, without repetitions.
std::vector<int> sent_controlwords(const Bench& bench, std::uint32_t id) {
  std::vector<int> words;
  for (const CanFrame& f : bench.log) {
    if (f.id != id) continue;
    const int word = f.data[0] | f.data[1] << 8;
    if (words.empty() || words.back() != word) words.push_back(word);
  }
  return words;
}

// ---------------------------------------------------------------------------- stopping

struct QuickStop : ::testing::TestWithParam<int> {};

TEST_P(QuickStop, BrakesToStandstillThenSwitchesThePowerStagesOff) {
  Bench bench;
  bench.left_axis().quick_stop_option = bench.right_axis().quick_stop_option = GetParam();
  bench.drive({1.0, 0.0}, milliseconds(600));
  bench.log.clear();
  bench.profile.stop(StopKind::quick);
  EXPECT_EQ(bench.phase(), DrivePhase::stopping);
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  EXPECT_EQ(bench.controlword(0x202), 0x0002);
  ASSERT_TRUE(bench.reach(DrivePhase::standby, milliseconds(1000))) << bench.reason();
  EXPECT_EQ(bench.left_axis().speed, 0);
  EXPECT_EQ(bench.left_axis().state, DriveState::switch_on_disabled);
  EXPECT_EQ(bench.right_axis().state, DriveState::switch_on_disabled);
  EXPECT_THAT(sent_controlwords(bench, 0x201), ::testing::ElementsAre(0x0002, 0x0000));
}

TEST_P(QuickStop, KeepsTheQuickStopCommandedWhileOneWheelTurns) {
  Bench bench;
  bench.left_axis().quick_stop_option = bench.right_axis().quick_stop_option = GetParam();
  bench.drive({1.0, 0.0}, milliseconds(600));
  bench.right_axis().ramp = 1;
  bench.profile.stop(StopKind::quick);
  while (bench.right_axis().speed != 0) {
    bench.cycle();
    EXPECT_EQ(bench.controlword(0x201), 0x0002);
    EXPECT_EQ(bench.controlword(0x202), 0x0002);
  }
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(100)));
}

INSTANTIATE_TEST_SUITE_P(OptionCodes, QuickStop, ::testing::Values(2, 6));

TEST(Cia402Profile, AStandstillThatIsNotToBeBelievedSwitchesNoPowerStageOff) {
  Bench bench;
  bench.drive({1.0, 0.0}, milliseconds(600));
  const Instant until = bench.now + milliseconds(1500);
  bench.profile.distrust_standstill(until);
  bench.profile.stop(StopKind::quick);
  while (bench.now + milliseconds(100) < until) {
    bench.cycle();
    ASSERT_EQ(bench.controlword(0x201), 0x0002);
    ASSERT_EQ(bench.controlword(0x202), 0x0002);
  }
  EXPECT_EQ(bench.left_axis().speed, 0);
  EXPECT_EQ(bench.phase(), DrivePhase::stopping);
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(300))) << bench.reason();
}

TEST(Cia402Profile, TheTargetIsZeroFromTheFirstCycleOfAStopOn) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.profile.stop(StopKind::quick);
  bench.profile.set_command({1.0, 0.0});
  bench.cycle();
  EXPECT_EQ(bench.target(0x201), 0);
  EXPECT_EQ(bench.target(0x202), 0);
}

TEST(Cia402Profile, AStopThatTakesTooLongStaysCommandedAndSaysWhy) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.right_axis().ramp = 0;
  bench.profile.stop(StopKind::quick);
  bench.run(milliseconds(5000));
  EXPECT_EQ(bench.reason(), "");
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::stopping);
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): its wheel still turns 5 s after the quick stop: check brake and "
            "load; stop stays commanded");
  EXPECT_EQ(bench.controlword(0x202), 0x0002);
  bench.right_axis().ramp = 10;
  EXPECT_TRUE(bench.reach(DrivePhase::standby));
  EXPECT_EQ(bench.reason(), "");
}

TEST(Cia402Profile, StandstillIsNotBelievedWithoutFreshFeedback) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.profile.stop(StopKind::quick);
  bench.left_axis().ramp = 0;
  bench.run(milliseconds(100));  // the quick stop is confirmed
  bench.left_axis().ramp = 10;
  bench.left().send_feedback = false;
  bench.left().unanswered = {0x606C, 0};
  bench.run(milliseconds(5100));
  EXPECT_EQ(bench.left_axis().speed, 0);
  EXPECT_EQ(bench.phase(), DrivePhase::stopping);
  EXPECT_EQ(bench.controlword(), 0x0002);
  EXPECT_FALSE(bench.snapshot().standstill);
  EXPECT_FALSE(bench.snapshot().feedback_fresh);
  EXPECT_TRUE(bench.snapshot().in_doubt);
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): feedback older than 100 ms (TPDOs 0x181, 0x281): check its "
            "supply and the CAN plug; stop stays commanded");
}

TEST(Cia402Profile, AStandstillOfBeforeTheStopIsNoneOfAfterIt) {
  Bench bench;
  bench.to_enabled();
  bench.left().send_feedback = false;
  bench.left().unanswered = {0x6040, 0};
  bench.profile.stop(StopKind::quick);
  bench.run(milliseconds(2500));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
}

TEST(Cia402Profile, DisableSwitchesStandingWheelsOffAtOnce) {
  Bench bench;
  bench.to_enabled();
  bench.log.clear();
  bench.profile.stop(StopKind::disable);
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(100)));
  EXPECT_THAT(sent_controlwords(bench, 0x201), ::testing::ElementsAre(0x0000));
}

TEST(Cia402Profile, DisableBrakesTurningWheelsFirst) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.profile.stop(StopKind::disable);
  bench.cycle();
  EXPECT_EQ(bench.controlword(), 0x0002);
  EXPECT_TRUE(bench.reach(DrivePhase::standby));
}

TEST(Cia402Profile, StopDuringEnablingLeadsToStandby) {
  Bench bench;
  bench.to_standby();
  bench.profile.enable();
  bench.cycle();
  bench.profile.stop(StopKind::quick);
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(200)));
  EXPECT_EQ(bench.left_axis().state, DriveState::switch_on_disabled);
}

TEST(Cia402Profile, AQuickStopIsSentToStandingWheelsToo) {
  Bench bench;
  bench.to_enabled();
  bench.log.clear();
  bench.profile.stop(StopKind::quick);
  ASSERT_TRUE(bench.reach(DrivePhase::standby, milliseconds(200)));
  EXPECT_THAT(sent_controlwords(bench, 0x201), ::testing::ElementsAre(0x0002, 0x0000));
  EXPECT_THAT(sent_controlwords(bench, 0x202), ::testing::ElementsAre(0x0002, 0x0000));
}

TEST(Cia402Profile, StopActsOnlyWhereThePowerStagesAreOnOrGoingOn) {
  Bench bench;
  bench.profile.start(bench.now);
  bench.profile.stop(StopKind::quick);
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  ASSERT_TRUE(bench.reach(DrivePhase::standby));
  bench.profile.stop(StopKind::disable);
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  bench.deliver(test::emergency(1, 0x3210));
  bench.profile.stop(StopKind::quick);
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Profile, APowerStageThatDoesNotGoOffFaults) {
  Bench bench;
  bench.to_enabled();
  bench.left().send_feedback = false;
  const auto left_stays_on = [&bench] {
    bench.deliver(CanFrame::make(0x181, {0x33, 0x02, 0, 0, 0, 0}));
    bench.deliver(CanFrame::make(0x281, {0, 0, 0, 0, 0, 0, 3}));
    bench.cycle();
  };
  bench.profile.stop(StopKind::quick);
  for (int i = 0; i < 40; ++i) left_stays_on();
  EXPECT_EQ(bench.phase(), DrivePhase::stopping);
  EXPECT_EQ(bench.right_axis().state, DriveState::switch_on_disabled);
  for (int i = 0; i < 20; ++i) left_stays_on();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.reason(),
            "left drive (node 1): is still in SwitchedOn 1000 ms after the command to switch its "
            "power stage off: switch off its supply");
}

TEST(Cia402Profile, CanBeEnabledAgainAfterAStop) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.profile.stop(StopKind::quick);
  ASSERT_TRUE(bench.reach(DrivePhase::standby));
  bench.profile.enable();
  ASSERT_TRUE(bench.reach(DrivePhase::enabled));
  bench.cycle();
  EXPECT_EQ(bench.target(0x201), 0);
}

// ---------------------------------------------------------------------------- foreign frames

TEST(Cia402Profile, FramesOfWrongLengthAreCountedAndChangeNothing) {
  Bench bench;
  bench.to_enabled();
  bench.deliver(CanFrame::make(0x181, {0x18, 0x02, 0, 0, 0}));           // Fault, but short
  bench.deliver(CanFrame::make(0x181, {0x18, 0x02, 0, 0, 0, 0, 0, 0}));  // long
  bench.deliver(CanFrame::make(0x281, {}));
  bench.deliver(CanFrame::make(0x081, {0x00, 0x75}));
  bench.deliver(CanFrame::make(0x701, {0x7F, 0x00}));
  bench.deliver(CanFrame::make(0x701, {}));
  bench.deliver(CanFrame::make(0x701, {0x33}));
  EXPECT_EQ(bench.profile.counters().rejected_frames, 7);
  bench.run(milliseconds(100));
  EXPECT_EQ(bench.phase(), DrivePhase::enabled) << bench.reason();
}

TEST(Cia402Profile, FeedbackOfWrongLengthRefreshesNothing) {
  Bench bench;
  bench.to_enabled();
  bench.left().send_feedback = false;
  for (int i = 0; i < 6; ++i) {
    bench.deliver(CanFrame::make(0x181, {0x37, 0x02, 0, 0, 0}));
    bench.cycle();
  }
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Profile, AHeartbeatOfWrongLengthRefreshesNothing) {
  Bench bench;
  bench.to_standby();
  bench.left().beat = false;
  for (int i = 0; i < 25; ++i) {
    bench.deliver(CanFrame::make(0x701, {0x05, 0x00}));
    bench.cycle();
  }
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Profile, ExtendedRemoteAndUnrelatedFramesAreIgnored) {
  Bench bench;
  bench.to_enabled();
  CanFrame f = CanFrame::make(0x701, {0x00});
  f.extended = true;
  bench.deliver(f);
  f.extended = false;
  f.remote = true;
  bench.deliver(f);
  bench.deliver(CanFrame::make(0x203, {0x00}));  // another node's RPDO
  bench.deliver(CanFrame::make(0x703, {0x00}));
  bench.deliver(CanFrame::make(0x381, {0x00}));  // a TPDO that is not mapped
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::enabled);
  EXPECT_EQ(bench.profile.counters().rejected_frames, 0);
  EXPECT_EQ(bench.profile.counters().intruder_frames, 0);
}

TEST(Cia402Profile, WantsToSeeEveryIdentifierOfItsDrivesAndOfIntruders) {
  const Bench bench;
  std::vector<std::uint32_t> wanted;
  for (const CanFilter& f : bench.profile.filters()) {
    EXPECT_EQ(f.mask, 0x7FFu);
    wanted.push_back(f.id);
  }
  EXPECT_THAT(wanted, ::testing::UnorderedElementsAre(0x000, 0x080, 0x77F, 0x081, 0x082, 0x181,
                                                      0x281, 0x182, 0x282, 0x201, 0x301, 0x401,
                                                      0x501, 0x202, 0x302, 0x402, 0x502, 0x581,
                                                      0x582, 0x601, 0x602, 0x701, 0x702));
}

}  // namespace
}  // namespace tether
