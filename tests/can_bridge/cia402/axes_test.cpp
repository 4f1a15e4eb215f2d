#include "can_bridge/cia402/profile/axes.hpp"

#include <gtest/gtest.h>

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

TEST(Axes, AnAxisStandsBeforeItsPowerGoesOff) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  ASSERT_TRUE(axes.on_feedback(feedback(1, 0x0017, 1000), kStart));
  EXPECT_EQ(axes.stop_controlword(0, kStart), canopen::kControlQuickStop);
  axes.on_feedback(feedback(1, 0x0017, 0), kStart);
  EXPECT_EQ(axes.stop_controlword(0, kStart), canopen::kControlDisableVoltage);
  EXPECT_TRUE(axes.released(0));
  EXPECT_EQ(axes.stop_controlword(1, kStart), canopen::kControlQuickStop) << "nothing is known";
}

TEST(Axes, ADistrustedStandstillSwitchesNoPowerOff) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.distrust_standstill(kStart + milliseconds(50));
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  axes.on_feedback(feedback(1, 0x0017, 0), kStart);
  EXPECT_EQ(axes.stop_controlword(0, kStart), canopen::kControlQuickStop);
  EXPECT_EQ(axes.stop_controlword(0, kStart + milliseconds(50)), canopen::kControlDisableVoltage);
}

TEST(Axes, OnlyFeedbackOfAfterTheQuickStopConfirmsAStandstill) {
  Axes axes(two_nodes(), 0.1, 0.5);
  std::vector<CanFrame> out;
  axes.on_feedback(feedback(1, 0x0017, 0), kStart);
  axes.send({canopen::kControlQuickStop, canopen::kControlQuickStop}, kStill, out);
  EXPECT_EQ(axes.stop_controlword(0, kStart), canopen::kControlQuickStop);
  axes.on_feedback(feedback(1, 0x0017, 0), kStart);
  EXPECT_EQ(axes.stop_controlword(0, kStart), canopen::kControlDisableVoltage);
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
