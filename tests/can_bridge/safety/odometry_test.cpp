#include "can_bridge/safety/odometry.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::numbers::pi;

constexpr double kExact = 1e-9;

struct OdometryTest : ::testing::Test {
  VehicleConfig vehicle;  // wheels of 0.4 m radius, 1.2 m apart
  std::array<WheelFeedback, 2> wheels;
  Instant now = kStart;

  OdometryTest() {
    for (WheelFeedback& w : wheels) w.valid = true;
  }
  /// The wheels' rims roll on by so much at constant speed within `duration`.
  void roll(Odometry& odometry, double left_m, double right_m, Duration duration, int steps = 1) {
    const double s = to_seconds(duration);
    for (int i = 0; i < steps; ++i) {
      now += duration / steps;
      turn(0, left_m / steps, left_m / s);
      turn(1, right_m / steps, right_m / s);
      odometry.update(wheels);
    }
  }
  void turn(std::size_t wheel, double rim_m, double speed_mps) {
    wheels[wheel].stamp = now;
    wheels[wheel].angle_rad += rim_m / vehicle.wheel_radius_m;
    wheels[wheel].speed_radps = speed_mps / vehicle.wheel_radius_m;
  }
  static void expect_pose(const Odometry& odometry, double x_m, double y_m, double yaw_rad) {
    EXPECT_NEAR(odometry.state().pose.x_m, x_m, kExact);
    EXPECT_NEAR(odometry.state().pose.y_m, y_m, kExact);
    EXPECT_NEAR(odometry.state().pose.yaw_rad, yaw_rad, kExact);
  }
};

TEST_F(OdometryTest, StartsAtTheVehiclesStartPose) {
  vehicle.start_x_m = 1.0;
  vehicle.start_y_m = -2.0;
  vehicle.start_yaw_rad = 4.0;
  const Odometry odometry(vehicle);
  expect_pose(odometry, 1.0, -2.0, 4.0 - 2 * pi);
  EXPECT_EQ(odometry.state().distance_m, 0.0);
  EXPECT_EQ(odometry.state().twist.v_mps, 0.0);
}

TEST_F(OdometryTest, TheFirstAngleIsWhereCountingBegins) {
  Odometry odometry(vehicle);
  wheels[0].angle_rad = 1000.0;
  wheels[1].angle_rad = -5.0;
  odometry.update(wheels);
  expect_pose(odometry, 0.0, 0.0, 0.0);
  EXPECT_EQ(odometry.reanchored(), 0);
}

TEST_F(OdometryTest, EqualWheelsGoStraightAlongTheYaw) {
  vehicle.start_yaw_rad = pi / 6;
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 2.0, 2.0, milliseconds{1000}, 50);
  expect_pose(odometry, 2.0 * std::cos(pi / 6), 1.0, pi / 6);
  EXPECT_NEAR(odometry.state().distance_m, 2.0, kExact);
  EXPECT_NEAR(odometry.state().twist.v_mps, 2.0, kExact);
  EXPECT_NEAR(odometry.state().twist.omega_radps, 0.0, kExact);
}

TEST_F(OdometryTest, AQuarterCircleIsExactInOneStepAsInMany) {
  for (const int steps : {1, 7, 1000}) {
    now = kStart;
    wheels[0].angle_rad = wheels[1].angle_rad = 0.0;
    Odometry odometry(vehicle);
    for (WheelFeedback& w : wheels) w.stamp = now;
    odometry.update(wheels);
    const double r_m = 3.0, quarter = pi / 2;
    roll(odometry, (r_m - 0.6) * quarter, (r_m + 0.6) * quarter, milliseconds{2000}, steps);
    expect_pose(odometry, r_m, r_m, quarter);
    EXPECT_NEAR(odometry.state().distance_m, r_m * quarter, kExact);
    EXPECT_NEAR(odometry.state().twist.omega_radps, quarter / 2.0, kExact);
  }
}

TEST_F(OdometryTest, TurningOnTheSpotCoversNoDistance) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, -0.6 * pi, 0.6 * pi, milliseconds{1000}, 10);
  EXPECT_NEAR(std::abs(odometry.state().pose.yaw_rad), pi, kExact);
  EXPECT_NEAR(odometry.state().pose.x_m, 0.0, kExact);
  EXPECT_NEAR(odometry.state().distance_m, 0.0, kExact);
}

TEST_F(OdometryTest, DistanceGrowsInReverseToo) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 1.0, 1.0, milliseconds{1000});
  roll(odometry, -1.0, -1.0, milliseconds{1000});
  expect_pose(odometry, 0.0, 0.0, 0.0);
  EXPECT_NEAR(odometry.state().distance_m, 2.0, kExact);
  EXPECT_NEAR(odometry.state().twist.v_mps, -1.0, kExact);
}

TEST_F(OdometryTest, AWheelWithoutNewFeedbackIsMadeUpForWhenItComes) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  now += milliseconds{20};
  odometry.update(wheels);
  now += milliseconds{20};
  turn(0, 0.04, 1.0);
  turn(1, 0.04, 1.0);
  odometry.update(wheels);
  expect_pose(odometry, 0.04, 0.0, 0.0);
}

TEST_F(OdometryTest, InvalidFeedbackStopsTheCountAndTheNextPairStartsAnew) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 0.1, 0.1, milliseconds{100});
  wheels[1].valid = false;
  roll(odometry, 0.1, 0.1, milliseconds{100});
  EXPECT_EQ(odometry.state().twist.v_mps, 0.0);
  wheels[1].valid = true;
  wheels[1].angle_rad = 0.0;  // its drive started anew
  odometry.update(wheels);
  expect_pose(odometry, 0.1, 0.0, 0.0);
  EXPECT_EQ(odometry.reanchored(), 1);
  roll(odometry, 0.1, 0.1, milliseconds{100});
  expect_pose(odometry, 0.2, 0.0, 0.0);
}

TEST_F(OdometryTest, AJumpThatNoWheelCouldMakeIsNoMotion) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 0.1, 0.1, milliseconds{100});
  wheels[0].angle_rad += 1000.0;
  roll(odometry, 0.1, 0.1, milliseconds{100});
  expect_pose(odometry, 0.1, 0.0, 0.0);
  EXPECT_EQ(odometry.reanchored(), 1);
  roll(odometry, 0.1, 0.1, milliseconds{100});
  expect_pose(odometry, 0.2, 0.0, 0.0);
}

TEST_F(OdometryTest, TheFastestWheelIsNoJump) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 10.0, 10.0, milliseconds{1000}, 50);
  expect_pose(odometry, 10.0, 0.0, 0.0);
  EXPECT_EQ(odometry.reanchored(), 0);
}

TEST_F(OdometryTest, NumbersThatAreNoneCountAsInvalid) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  wheels[0].angle_rad = std::numeric_limits<double>::quiet_NaN();
  odometry.update(wheels);
  wheels[0].angle_rad = 0.0;
  wheels[1].speed_radps = std::numeric_limits<double>::infinity();
  odometry.update(wheels);
  expect_pose(odometry, 0.0, 0.0, 0.0);
  EXPECT_EQ(odometry.state().twist.v_mps, 0.0);
}

}  // namespace
}  // namespace tether
