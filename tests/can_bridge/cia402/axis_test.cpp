#include "can_bridge/cia402/axis.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <numbers>

namespace tether::cia402 {
namespace {

using canopen::DriveState;
using std::chrono::milliseconds;

constexpr double kTurn_rad = 2.0 * std::numbers::pi;

Instant at(int ms) { return Instant{milliseconds(ms)}; }

struct AxisTest : ::testing::Test {
  AxisConfig config;
  Axis axis = make();

  Axis make() { return {config, "left drive (node 1)", milliseconds(100), 0.05}; }
  void status(std::int64_t word, int ms) {
    axis.receive({Signal::statusword, 0, config.statusword, 0}, word, at(ms));
  }
  void speed(std::int64_t rpm, int ms) {
    axis.receive({Signal::actual_velocity, 0, config.actual_velocity, 0}, rpm, at(ms));
  }
  void position(std::int64_t counts, int ms) {
    axis.receive({Signal::actual_position, 0, config.actual_position, 0}, counts, at(ms));
  }
  std::int64_t counts() const { return axis.feedback().position_counts; }
};

TEST_F(AxisTest, KnowsNothingBeforeTheFirstFeedback) {
  EXPECT_FALSE(axis.feedback().valid);
  EXPECT_EQ(axis.feedback().state, "unknown");
  EXPECT_FALSE(axis.fresh(at(0)));
  EXPECT_FALSE(axis.standing(at(0)));
  EXPECT_EQ(axis.age(at(0)), Duration::max());
}

TEST_F(AxisTest, TheFirstPositionIsTheOrigin) {
  position(123456, 0);
  EXPECT_TRUE(axis.feedback().valid);
  EXPECT_EQ(counts(), 0);
  position(123456 + 1024, 20);
  EXPECT_EQ(counts(), 1024);
  EXPECT_DOUBLE_EQ(axis.feedback().angle_rad, kTurn_rad / 4);
  EXPECT_EQ(axis.feedback().stamp, at(20));
}

TEST_F(AxisTest, CountsThroughThe32BitWrapAroundInBothDirections) {
  position(INT32_MAX - 10, 0);
  position(static_cast<std::int64_t>(INT32_MIN) + 9, 20);
  EXPECT_EQ(counts(), 20);
  position(INT32_MAX - 10, 40);
  EXPECT_EQ(counts(), 0);
}

TEST_F(AxisTest, CountsThroughThe16BitWrapAround) {
  config.actual_position = {0x6064, 0, 2, false};
  axis = make();
  position(65530, 0);
  position(4, 20);
  EXPECT_EQ(counts(), 10);
}

TEST_F(AxisTest, AReversedMountingTurnsSignsOfAngleSpeedAndTarget) {
  config.sign = -1;
  axis = make();
  position(0, 0);
  position(1024, 20);
  speed(60, 20);
  EXPECT_EQ(counts(), -1024);
  EXPECT_DOUBLE_EQ(axis.feedback().speed_radps, -kTurn_rad);
  EXPECT_DOUBLE_EQ(axis.target_units(kTurn_rad), -60.0);
}

TEST_F(AxisTest, ScalesByExactRatios) {
  config.target_velocity_per_rps = {512LL * 4096, 1875};  // a drive that takes rpm·512·res/1875
  config.actual_velocity_per_rps = {600, 1};              // 0.1 rpm
  axis = make();
  EXPECT_DOUBLE_EQ(axis.target_units(kTurn_rad * 1875), 512.0 * 4096);
  speed(600, 0);
  EXPECT_DOUBLE_EQ(axis.feedback().speed_radps, kTurn_rad);
}

TEST_F(AxisTest, AReAnchoredEncoderContinuesTheAngle) {
  position(1000, 0);
  position(1500, 20);
  axis.reanchor();
  position(0, 2000);
  EXPECT_EQ(counts(), 500);
  position(7, 2020);
  EXPECT_EQ(counts(), 507);
}

TEST_F(AxisTest, ACounterResetWithoutNoticeDoesNotMoveTheAngle) {
  position(1'000'000, 0);
  speed(60, 0);
  position(1'000'082, 20);
  position(0, 40);
  EXPECT_EQ(counts(), 82);
  position(82, 60);
  EXPECT_EQ(counts(), 164);
}

TEST_F(AxisTest, TravelDuringAGapInTheFeedbackIsNotLost) {
  position(0, 0);
  speed(600, 0);
  position(40960, 1000);  // ten turns in a second of silence
  EXPECT_EQ(counts(), 40960);
}

TEST_F(AxisTest, TravelDuringAGapInWhichTheWheelBrakedIsNotLost) {
  position(0, 0);
  speed(120, 0);  // 2 turns a second
  position(0, 0);
  speed(0, 1000);  // the drive's speed comes before its position
  position(4096, 1000);
  EXPECT_EQ(counts(), 4096);
  EXPECT_EQ(axis.feedback().uncounted_rad, 0.0);
}

TEST_F(AxisTest, MoreThanTheWheelCanHaveTurnedInAGapIsACounterReset) {
  speed(60, 0);
  position(0, 0);
  position(3LL * 4096, 1000);  // a turn, and twice that of one turn a second
  EXPECT_EQ(counts(), 3 * 4096);
  position(3 * 4096 + 3 * 4096 + 1, 2000);
  EXPECT_EQ(counts(), 3 * 4096);
  EXPECT_GT(axis.feedback().uncounted_rad, 3 * kTurn_rad);
}

TEST_F(AxisTest, AcrossARebootNoCountIsBelievedAndTheWheelMayHaveRolledOut) {
  speed(60, 0);
  position(1000, 0);
  axis.reanchor();
  position(1500, 2000);  // position as if it had gone on
  EXPECT_EQ(counts(), 0);
  // 2 s at one turn a second, and at the speed that still counts as standing.
  EXPECT_NEAR(axis.feedback().uncounted_rad, 2.0 * (kTurn_rad + 0.05), 1e-9);
  axis.reanchor();
  position(0, 62'000);
  EXPECT_NEAR(axis.feedback().uncounted_rad, 12.0 * (kTurn_rad + 0.05), 1e-9) << "10 s at most";
}

TEST_F(AxisTest, WhatWasReadBySdoBeforeAResetIsCountedAndTheWheelStood) {
  speed(60, 0);
  position(1000, 0);
  axis.take_up(1500, at(800));
  axis.begin();
  EXPECT_EQ(counts(), 500);
  position(0, 1800);
  EXPECT_EQ(counts(), 500);
  EXPECT_NEAR(axis.feedback().uncounted_rad, 0.05, 1e-9);
}

TEST_F(AxisTest, WhatWasReadBySdoAfterABootUpIsNotCounted) {
  position(1000, 0);
  axis.reanchor();
  axis.take_up(1500, at(800));
  EXPECT_EQ(counts(), 0);
}

TEST_F(AxisTest, ANewStartKeepsTheAngleAndForgetsTheRest) {
  status(0x0237, 0);
  position(0, 0);
  position(100, 20);
  speed(60, 20);
  axis.begin();
  EXPECT_FALSE(axis.feedback().valid);
  EXPECT_EQ(axis.feedback().speed_radps, 0.0);
  EXPECT_EQ(axis.state(), std::nullopt);
  EXPECT_EQ(counts(), 100);
}

TEST_F(AxisTest, IsFreshUntilJustBeforeTheTimeoutOfItsOldestSignal) {
  status(0x0250, 0);
  speed(0, 10);
  EXPECT_FALSE(axis.fresh(at(10)));  // no position yet
  position(0, 20);
  EXPECT_TRUE(axis.fresh(at(99)));
  EXPECT_FALSE(axis.fresh(at(100)));
}

TEST_F(AxisTest, StandsBelowTheThresholdAndOnlyByFreshFeedback) {
  config.actual_velocity_per_rps = {60000, 1};
  axis = make();
  for (const int ms : {0, 50, 100}) position(1000, ms);
  speed(477, 100);  // 0.04995 rad/s
  EXPECT_TRUE(axis.standing(at(199)));
  EXPECT_FALSE(axis.standing(at(200)));
  position(1000, 200);
  speed(478, 200);  // 0.05006 rad/s
  EXPECT_TRUE(axis.turning(at(200)));
  speed(-478, 200);
  EXPECT_TRUE(axis.turning(at(200)));
}

TEST_F(AxisTest, AStatuswordFromBeforeTheControlwordConfirmsNothing) {
  status(0x0231, 0);
  speed(0, 0);
  EXPECT_EQ(axis.confirmed_state(), DriveState::ready_to_switch_on);
  axis.command(0x0007);
  EXPECT_EQ(axis.confirmed_state(), std::nullopt);
  EXPECT_FALSE(axis.confirmed_standing(at(1)));
  EXPECT_EQ(axis.state(), DriveState::ready_to_switch_on);
  axis.command(0x0007);  // the same again needs no new confirmation later
  status(0x0233, 20);
  axis.command(0x0007);
  EXPECT_EQ(axis.confirmed_state(), DriveState::switched_on);
}

TEST_F(AxisTest, ClimbsOneStepForEachConfirmedState) {
  status(0x0250, 0);
  EXPECT_EQ(axis.enabling_controlword(), 0x0006);
  axis.command(0x0006);
  EXPECT_EQ(axis.enabling_controlword(), 0x0006);  // stale statusword
  status(0x0250, 20);
  EXPECT_EQ(axis.enabling_controlword(), 0x0006);  // not there yet
  status(0x0231, 40);
  EXPECT_EQ(axis.enabling_controlword(), 0x0007);
  axis.command(0x0007);
  status(0x0233, 60);
  EXPECT_EQ(axis.enabling_controlword(), 0x000F);
  axis.command(0x000F);
  status(0x0237, 80);
  EXPECT_EQ(axis.enabling_controlword(), 0x000F);
}

TEST_F(AxisTest, NeverClimbsOutOfQuickStopOrFault) {
  for (const std::int64_t word : {0x0217, 0x0218, 0x021F, 0x0200}) {
    status(word, 0);
    EXPECT_EQ(axis.enabling_controlword(), 0x0000) << word;
  }
}

TEST_F(AxisTest, TakesItsHalfOfASharedStatusword) {
  config.statusword = {0x6041, 0, 4, false};
  config.statusword_shift = 16;
  axis = make();
  status(0x02370218, 0);
  EXPECT_EQ(axis.state(), DriveState::operation_enabled);
  EXPECT_EQ(axis.feedback().statusword, 0x0237u);
}

TEST_F(AxisTest, TheErrorObjectGoesBeforeTheEmergencyCode) {
  axis.on_emergency(0x8130);
  EXPECT_EQ(axis.error_code(), 0x8130u);
  axis.receive({Signal::error_code, 0, config.error_code, 0}, 0x3210, at(0));
  EXPECT_EQ(axis.error_code(), 0x3210u);
}

}  // namespace
}  // namespace tether::cia402
