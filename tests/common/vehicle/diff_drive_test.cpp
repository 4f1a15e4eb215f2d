#include "common/vehicle/diff_drive.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>

namespace tether {
namespace {

constexpr double kWheelTrack_m = 1.2;
constexpr double kHalfTurn = std::numbers::pi;

TEST(DiffDrive, AFasterRightWheelTurnsLeft) {
  const Twist u = to_twist({.left_mps = 1.0, .right_mps = 2.2}, kWheelTrack_m);
  EXPECT_DOUBLE_EQ(u.v_mps, 1.6);
  EXPECT_DOUBLE_EQ(u.omega_radps, 1.0);
}

TEST(DiffDrive, EqualWheelsGoStraight) {
  const Twist u = to_twist({.left_mps = -3.0, .right_mps = -3.0}, kWheelTrack_m);
  EXPECT_EQ(u.v_mps, -3.0);
  EXPECT_EQ(u.omega_radps, 0.0);
}

TEST(DiffDrive, TurningLeftOnTheSpotDrivesTheLeftWheelBackwards) {
  const WheelSpeeds w = to_wheel_speeds({.v_mps = 0.0, .omega_radps = 1.0}, kWheelTrack_m);
  EXPECT_DOUBLE_EQ(w.left_mps, -0.6);
  EXPECT_DOUBLE_EQ(w.right_mps, 0.6);
}

TEST(DiffDrive, WheelSpeedsAndTwistAreInverses) {
  for (const double v : {-8.0, 0.0, 0.3, 8.0}) {
    for (const double omega : {-2.0, 0.0, 0.7, 2.0}) {
      const Twist back = to_twist(to_wheel_speeds({v, omega}, kWheelTrack_m), kWheelTrack_m);
      EXPECT_NEAR(back.v_mps, v, 1e-14);
      EXPECT_NEAR(back.omega_radps, omega, 1e-14);
    }
  }
}

TEST(DiffDrive, SaturationKeepsTheCurvature) {
  const WheelSpeeds wanted{.left_mps = 8.0, .right_mps = 16.0};
  const WheelSpeeds got = saturate(wanted, 10.0);
  EXPECT_DOUBLE_EQ(got.right_mps, 10.0);
  EXPECT_DOUBLE_EQ(got.left_mps, 5.0);
  const Twist before = to_twist(wanted, kWheelTrack_m), after = to_twist(got, kWheelTrack_m);
  EXPECT_DOUBLE_EQ(after.omega_radps / after.v_mps, before.omega_radps / before.v_mps);
}

TEST(DiffDrive, SaturationLimitsTheFasterWheelInEitherDirection) {
  EXPECT_DOUBLE_EQ(saturate({-20.0, 4.0}, 10.0).left_mps, -10.0);
  EXPECT_DOUBLE_EQ(saturate({-20.0, 4.0}, 10.0).right_mps, 2.0);
}

TEST(DiffDrive, SaturationLeavesSpeedsUpToTheLimitAlone) {
  const WheelSpeeds w = saturate({-10.0, 10.0}, 10.0);
  EXPECT_EQ(w.left_mps, -10.0);
  EXPECT_EQ(w.right_mps, 10.0);
}

TEST(WrapAngle, GivesTheSameDirectionAboveMinusPiAndUpToPi) {
  EXPECT_EQ(wrap_angle(0.0), 0.0);
  EXPECT_EQ(wrap_angle(kHalfTurn), kHalfTurn);
  EXPECT_EQ(wrap_angle(-kHalfTurn), kHalfTurn);
  EXPECT_NEAR(wrap_angle(kHalfTurn + 0.1), -kHalfTurn + 0.1, 1e-14);
  EXPECT_NEAR(wrap_angle(-kHalfTurn - 0.1), kHalfTurn - 0.1, 1e-14);
  for (double a = -100.0; a < 100.0; a += 0.37) {
    const double wrapped = wrap_angle(a);
    EXPECT_GT(wrapped, -kHalfTurn);
    EXPECT_LE(wrapped, kHalfTurn);
    EXPECT_NEAR(std::cos(wrapped), std::cos(a), 1e-12);
    EXPECT_NEAR(std::sin(wrapped), std::sin(a), 1e-12);
  }
}

TEST(IsFinite, OneBadNumberSpoilsPoseAndTwist) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(is_usable(Pose2{1.0, 2.0, 3.0}));
  EXPECT_FALSE(is_usable(Pose2{kNan, 2.0, 3.0}));
  EXPECT_FALSE(is_usable(Pose2{1.0, -kInf, 3.0}));
  EXPECT_FALSE(is_usable(Pose2{1.0, 2.0, kNan}));
  EXPECT_TRUE(is_usable(Twist{1.0, 2.0}));
  EXPECT_FALSE(is_usable(Twist{kInf, 2.0}));
  EXPECT_FALSE(is_usable(Twist{1.0, kNan}));
}

}  // namespace
}  // namespace tether
