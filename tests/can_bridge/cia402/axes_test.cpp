#include "can_bridge/cia402/axes.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "tests/can_bridge/cia402/bench.hpp"

namespace tether::cia402 {
namespace {

using std::chrono::milliseconds;
using ::tether::test::pdo;
using ::tether::test::two_nodes;

constexpr std::array<std::int64_t, 2> kStill{0, 0};

/// The statusword and speed of an axis of two_nodes().
CanFrame feedback(std::uint8_t node, std::uint16_t statusword, std::int32_t speed = 0) {
  CanFrame frame = CanFrame::make(0x180 + node, {0, 0, 0, 0, 0, 0});
  canopen::write_integer(frame.data.data(), 2, statusword);
  canopen::write_integer(frame.data.data() + 2, 4, speed);
  return frame;
}

/// 100 ms in which axis 1 reports that it stands, the position included; returns its end.
Instant stand(Axes& axes, Instant from = kStart) {
  const Instant until = from + milliseconds(100);
  for (Instant t = from; t <= until; t += milliseconds(20)) {
    axes.on_feedback(feedback(1, 0x0017, 0), t);
    axes.on_feedback(CanFrame::make(0x281, {7, 0, 0, 0, 0, 0, 3}), t);
  }
  return until;
}

TEST(Axes, AnAxisStandsBeforeItsPowerGoesOff) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  ASSERT_TRUE(axes.on_feedback(feedback(1, 0x0017, 1000), kStart));
  EXPECT_EQ(axes.stop_controlword(0, kStart), canopen::kControlQuickStop);
  const Instant now = stand(axes);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlDisableVoltage);
  EXPECT_TRUE(axes.released(0));
  EXPECT_EQ(axes.stop_controlword(1, now), canopen::kControlQuickStop) << "nothing is known";
}

TEST(Axes, ASpeedOfZeroAloneSwitchesNoPowerOff) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  for (int ms = 0; ms <= 400; ms += 20) {
    axes.on_feedback(feedback(1, 0x0017, 0), kStart + milliseconds(ms));
    EXPECT_EQ(axes.stop_controlword(0, kStart + milliseconds(ms)), canopen::kControlQuickStop);
  }
}

/// One cycle of a stop in which both witnesses of the left wheel report standstill.
bool switches_power_off_when_both_witnesses_stand(Axes& axes, Instant now) {
  axes.bound_speeds(now, kStill);
  axes.on_feedback(feedback(1, 0x0017, 0), now);
  axes.on_feedback(CanFrame::make(0x281, {7, 0, 0, 0, 0, 0, 3}), now);
  return axes.stop_controlword(0, now) == canopen::kControlDisableVoltage;
}

TEST(Axes, NoWheelStandsSoonerThanItsRampCanStopItWhateverBothWitnessesSay) {
  // 0x6085 = 3000 rpm/s: from 600 rpm in 0.2 s, and 60 ms in which the drive has not begun. The
  // stop is sent after 20 ms.
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  Instant now = stand(axes);
  axes.bound_speeds(now, {600, 0});
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  for (int ms = 20; ms <= 280; ms += 20) {
    now += milliseconds(20);
    EXPECT_EQ(switches_power_off_when_both_witnesses_stand(axes, now), ms >= 260) << ms;
  }
}

TEST(Axes, WheelsFollowedTheirTargetsWhileTheBridgeWasHeldUp) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  Instant now = stand(axes);
  axes.bound_speeds(now, {100, 0});
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  now += milliseconds(500);  // 100 rpm are braked in 34 ms
  for (int ms = 0; ms <= 200; ms += 20, now += milliseconds(20)) {
    EXPECT_EQ(switches_power_off_when_both_witnesses_stand(axes, now), ms >= 80) << ms;
  }
}

TEST(Axes, WheelsRollOutInSlowCyclesToo) {
  // 60 of each 100 ms count: 600 rpm are braked in 200 ms, by the fourth cycle after the stop.
  Axes axes(two_nodes(), 0.1, 0.5);
  Instant now = stand(axes);
  axes.bound_speeds(now, {600, 0});
  EXPECT_FALSE(axes.can_have_stopped(1));
  for (int cycle = 1; cycle <= 8; ++cycle) {
    now += milliseconds(100);
    axes.bound_speeds(now, kStill);
    EXPECT_EQ(axes.can_have_stopped(1), cycle >= 5) << cycle;
  }
}

TEST(Axes, AnImpossibleReportDelaysStandstillByTheRampFromAPossibleSpeedOnly) {
  // 3000 rpm/s: from 10 rev/s in 0.2 s; from the 2 147 483 647 rpm of one forged frame in days.
  Axes axes(two_nodes(), 0.1, 0.5);
  axes.limit_reports(2.0 * std::numbers::pi * 10.0);
  Instant now = stand(axes);
  axes.on_feedback(feedback(1, 0x0017, 0x7FFFFFFF), now);
  axes.bound_speeds(now, kStill);
  for (int ms = 20; ms <= 320; ms += 20) {
    now += milliseconds(20);
    axes.on_feedback(feedback(1, 0x0017, 0), now);
    axes.on_feedback(CanFrame::make(0x281, {7, 0, 0, 0, 0, 0, 3}), now);
    axes.bound_speeds(now, kStill);
    EXPECT_EQ(axes.stands(0, now), ms >= 240) << ms;
  }
}

TEST(Axes, AnAxisThatStopsBySetpointIsEnabledUntilItStands) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.on_feedback(feedback(1, 0x0237, 1000), kStart);
  axes.stop_by_setpoint(0);
  EXPECT_EQ(axes.stop_controlword(0, kStart), canopen::kControlEnableOperation);
  EXPECT_EQ(axes.stop_controlword(1, kStart), canopen::kControlQuickStop);
  axes.send({canopen::kControlEnableOperation, canopen::kControlQuickStop}, kStill, out);
  EXPECT_EQ(axes.sdo_stop_words()[0], canopen::kControlQuickStop) << "SDO switches nothing on";
  const Instant now = stand(axes);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlDisableVoltage);
}

TEST(Axes, AnAxisThatIsOffIsNotEnabledToStopIt) {
  Axes axes(two_nodes(), 0.1, 0.5);
  axes.stop_by_setpoint(0);
  for (const std::uint16_t state : {0x0231, 0x0233, 0x0218}) {
    axes.on_feedback(feedback(1, state, 1000), kStart);
    EXPECT_EQ(axes.braking_controlword(0), canopen::kControlQuickStop);
  }
}

TEST(Axes, AnAxisThatAnotherSwitchesOnAgainIsBrakedAgain) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  const Instant now = stand(axes);
  ASSERT_EQ(axes.stop_controlword(0, now), canopen::kControlDisableVoltage);
  axes.on_feedback(feedback(1, 0x0237, 100), now);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlQuickStop);
}

TEST(Axes, APositionOfAfterTheQuickStopAloneConfirmsNoStandstill) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  const Instant now = stand(axes);
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  axes.on_feedback(CanFrame::make(0x281, {7, 0, 0, 0, 0, 0, 3}), now);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlQuickStop);
}

TEST(Axes, ADistrustedStandstillSwitchesNoPowerOff) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.distrust_standstill(kStart + milliseconds(150));
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  const Instant now = stand(axes);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlQuickStop);
  EXPECT_EQ(axes.stop_controlword(0, now + milliseconds(50)), canopen::kControlDisableVoltage);
}

TEST(Axes, OnlyFeedbackOfAfterTheQuickStopConfirmsAStandstill) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  const Instant now = stand(axes);
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlQuickStop);
  axes.on_feedback(feedback(1, 0x0017, 0), now);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlQuickStop) << "no position yet";
  axes.on_feedback(CanFrame::make(0x281, {7, 0, 0, 0, 0, 0, 3}), now);
  EXPECT_EQ(axes.stop_controlword(0, now), canopen::kControlDisableVoltage);
}

TEST(Axes, OneControlwordForBothAxesIsTheMoreCautious) {
  Cia402Config config = two_nodes();
  config.axes[1] = config.axes[0];
  config.axes[1].target_velocity.sub = config.axes[1].actual_velocity.sub =
      config.axes[1].actual_position.sub = 1;
  config.pdos = {pdo(1, 1, false, {config.axes[0].controlword}),
                 pdo(1, 2, false, {config.axes[0].target_velocity, config.axes[1].target_velocity}),
                 pdo(1, 1, true, {config.axes[0].statusword}),
                 pdo(1, 2, true, {config.axes[0].actual_velocity, config.axes[1].actual_velocity}),
                 pdo(1, 3, true, {config.axes[0].actual_position, config.axes[1].actual_position})};
  Axes axes(config, 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.send({canopen::kControlEnableOperation, canopen::kControlQuickStop}, {7, -7}, out);
  ASSERT_EQ(out.size(), 2U);
  EXPECT_EQ(out[0], CanFrame::make(0x201, {0x02, 0x00}));
  EXPECT_EQ(axes[0].controlword(), canopen::kControlQuickStop);
  EXPECT_EQ(axes[1].controlword(), canopen::kControlQuickStop);
}

TEST(Axes, AFrameOfAnotherLengthTellsNothing) {
  Axes axes(two_nodes(), 0.1, 0.5);
  CanFrame frame = feedback(1, 0x0040);
  --frame.size;
  EXPECT_FALSE(axes.on_feedback(frame, kStart));
  EXPECT_EQ(axes[0].state(), std::nullopt);
}

}  // namespace
}  // namespace tether::cia402
