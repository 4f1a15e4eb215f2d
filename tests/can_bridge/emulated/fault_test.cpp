#include <gtest/gtest.h>

#include <numbers>

#include "tests/can_bridge/emulated/drive_rig.hpp"

namespace tether {
namespace {

using test::DriveRig;
using test::two_node_drivetrain;

constexpr double kRpm = 2.0 * std::numbers::pi / 60.0;  // in rad/s

// ---------------------------------------------------------------------------- wheels

TEST(EmulatedWheels, TheRightWheelIsMountedTheOtherWayRound) {
  DriveRig rig(two_node_drivetrain());
  for (const std::uint8_t node : {1, 2}) {
    rig.enable_by_sdo(node);
    rig.write(node, 0x6083, 0, 4, 60'000);
    rig.write(node, 0x60FF, 0, 4, 60);
  }
  rig.run(10);
  EXPECT_NEAR(rig.drives().wheel_targets_radps()[0], 60.0 * kRpm, 1e-9);
  EXPECT_NEAR(rig.drives().wheel_targets_radps()[1], -60.0 * kRpm, 1e-9);
}

TEST(EmulatedWheels, AnglesBecomeCountsAndSpeedsBecomeRpmWithTheSign) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.wheels_follow = false;
  const double turn_rad = 2.0 * std::numbers::pi;
  rig.drives().set_wheels({{turn_rad, turn_rad / 2}, {30.0 * kRpm, 45.0 * kRpm}});
  rig.run(1);
  EXPECT_EQ(rig.read_signed(1, 0x6064, 0), 4096);
  EXPECT_EQ(rig.read_signed(2, 0x6064, 0), -2048);
  EXPECT_EQ(rig.read_signed(1, 0x606C, 0), 30);
  EXPECT_EQ(rig.read_signed(2, 0x606C, 0), -45);
}

TEST(EmulatedWheels, ThePositionWrapsAsA32BitRegister) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.wheels_follow = false;
  const double turns = 524'288.0;  // 2³¹ counts
  rig.drives().set_wheels({{2.0 * std::numbers::pi * (turns + 1.0), 0.0}, {}});
  rig.run(1);
  EXPECT_EQ(rig.read_signed(1, 0x6064, 0), INT32_MIN + 4096);
}

TEST(EmulatedWheels, CountFromWhereTheyStoodAtPowerOn) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.wheels_follow = false;
  rig.drives().set_wheels({{10.0, 10.0}, {}});
  rig.nmt(0x81, 1);
  rig.run(400);
  EXPECT_EQ(rig.read_signed(1, 0x6064, 0), 0);
  EXPECT_EQ(rig.read_signed(2, 0x6064, 0), -6519);
}

// ---------------------------------------------------------------------------- injected faults

class Injection : public ::testing::Test {
 protected:
  Injection() {
    rig_.run(400);
    rig_.forget_sent();
  }
  void inject(DriveFault::Kind kind, double value = 0.0, int node = 1) {
    rig_.drives().inject({node, kind, value}, rig_.now());
  }
  DriveRig rig_{two_node_drivetrain()};
};

TEST_F(Injection, AFaultHasItsErrorCodeInEmcyAnd603F) {
  inject(DriveFault::Kind::fault, 0x2310);
  rig_.run(2);
  ASSERT_EQ(rig_.sent(0x081).size(), 1u);
  EXPECT_EQ(rig_.sent(0x081)[0].frame, CanFrame::make(0x081, {0x10, 0x23, 0x03, 0, 0, 0, 0, 0}));
  EXPECT_EQ(rig_.read(1, 0x603F, 0), 0x2310);
  EXPECT_EQ(rig_.read(1, 0x1001, 0), 0x03);
  EXPECT_EQ(rig_.state(1) & 0x4F, 0x08);
  EXPECT_EQ(rig_.state(2) & 0x4F, 0x40);
}

TEST_F(Injection, AFaultWithoutCodeIs7500AndNode0MeansAll) {
  inject(DriveFault::Kind::fault, 0, 0);
  rig_.run(2);
  EXPECT_EQ(rig_.read(1, 0x603F, 0), 0x7500);
  EXPECT_EQ(rig_.read(2, 0x603F, 0), 0x7500);
}

TEST_F(Injection, AnUnknownNodeIsNotAccepted) {
  inject(DriveFault::Kind::fault, 0, 3);
  rig_.run(2);
  EXPECT_TRUE(rig_.sent().empty());
}

TEST_F(Injection, ARebootMidMotionIsAnUnsolicitedBootUpMessage) {
  rig_.enable_by_sdo();
  rig_.write(1, 0x60FF, 0, 4, 60);
  rig_.run(500);
  EXPECT_GT(rig_.drives().wheel_targets_radps()[0], 0.0);
  rig_.forget_sent();
  inject(DriveFault::Kind::reboot);
  EXPECT_EQ(rig_.drives().wheel_targets_radps()[0], 0.0);
  rig_.run(300);
  ASSERT_EQ(rig_.sent().size(), 1u);
  EXPECT_EQ(rig_.sent()[0].frame, CanFrame::make(0x701, {0x00}));
  EXPECT_EQ(rig_.node().counters().boots, 2);
}

TEST_F(Injection, SilenceSaysNothingButStillHears) {
  rig_.write(1, 0x1017, 0, 2, 10);
  rig_.run(20);
  rig_.forget_sent();
  inject(DriveFault::Kind::silence, 0.1);
  EXPECT_EQ(rig_.write(1, 0x6083, 0, 4, 77), -1);
  rig_.run(99);
  EXPECT_TRUE(rig_.sent().empty());
  rig_.run(11);
  EXPECT_FALSE(rig_.sent().empty());
  EXPECT_EQ(rig_.read(1, 0x6083, 0), 77) << "heard all the same";
}

TEST_F(Injection, SilenceForGoodEndsWithNone) {
  inject(DriveFault::Kind::silence, 0.0);
  rig_.run(10'000);
  EXPECT_EQ(rig_.abort_of_read(1, 0x1000, 0), -1);
  inject(DriveFault::Kind::none);
  EXPECT_EQ(rig_.abort_of_read(1, 0x1000, 0), 0);
}

TEST_F(Injection, AFrozenEncoderStandsStillWhileTheWheelTurns) {
  rig_.wheels_follow = false;
  rig_.drives().set_wheels({{1.0, 0.0}, {5.0, 0.0}});
  inject(DriveFault::Kind::encoder_freeze);
  rig_.drives().set_wheels({{9.0, 0.0}, {5.0, 0.0}});
  rig_.run(1);
  EXPECT_EQ(rig_.read_signed(1, 0x6064, 0), 652);
  EXPECT_EQ(rig_.read_signed(1, 0x606C, 0), 0);
  inject(DriveFault::Kind::none);
  rig_.drives().set_wheels({{10.0, 0.0}, {5.0, 0.0}});
  rig_.run(1);
  EXPECT_EQ(rig_.read_signed(1, 0x6064, 0), 1304) << "what it missed is lost";
}

TEST_F(Injection, ASlippingWheelShowsTheEncoderOnlyAShare) {
  rig_.wheels_follow = false;
  inject(DriveFault::Kind::wheel_slip, 0.25);
  rig_.drives().set_wheels({{2.0 * std::numbers::pi, 0.0}, {40.0 * kRpm, 0.0}});
  rig_.run(1);
  EXPECT_EQ(rig_.read_signed(1, 0x6064, 0), 3072);
  EXPECT_EQ(rig_.read_signed(1, 0x606C, 0), 30);
}

}  // namespace
}  // namespace tether
