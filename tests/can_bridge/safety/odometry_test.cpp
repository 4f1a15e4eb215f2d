#include "can_bridge/safety/odometry.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

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

TEST_F(OdometryTest, WhatTheDrivesCountedWhileFeedbackWasInvalidIsTakenUp) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 0.1, 0.1, milliseconds{100});
  wheels[1].valid = false;
  roll(odometry, 0.98, 0.98, milliseconds{700});
  EXPECT_EQ(odometry.state().twist.v_mps, 0.0);
  expect_pose(odometry, 0.1, 0.0, 0.0);
  wheels[1].valid = true;
  odometry.update(wheels);
  expect_pose(odometry, 1.08, 0.0, 0.0);
  EXPECT_EQ(odometry.gaps(), 1);
  EXPECT_EQ(odometry.reanchored(), 0);
  roll(odometry, 0.1, 0.1, milliseconds{100});
  expect_pose(odometry, 1.18, 0.0, 0.0);
  EXPECT_EQ(odometry.gaps(), 1);
}

TEST_F(OdometryTest, UncountedTravelOfARebootedDriveMovesNothingAndIsReported) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 0.1, 0.1, milliseconds{100});
  wheels[1].valid = false;
  odometry.update(wheels);
  wheels[1].valid = true;
  wheels[1].uncounted_rad = 0.6 / vehicle.wheel_radius_m;
  odometry.update(wheels);
  expect_pose(odometry, 0.1, 0.0, 0.0);
  EXPECT_EQ(odometry.reanchored(), 1);
  EXPECT_EQ(odometry.gaps(), 0);
  // 0.36/3 m² of one wheel: a quarter of it along the way, over 1.2 m of track as yaw.
  EXPECT_NEAR(odometry.state().covariance.x_x, 0.03, 1e-5);
  EXPECT_NEAR(odometry.state().covariance.yaw_yaw, 0.12 / 1.44, 1e-5);
  odometry.update(wheels);
  EXPECT_EQ(odometry.reanchored(), 1) << "once";
  wheels[0].uncounted_rad = 0.6 / vehicle.wheel_radius_m;
  odometry.update(wheels);
  EXPECT_EQ(odometry.reanchored(), 2);
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

TEST_F(OdometryTest, AJumpMakesThePoseAsUncertainAsAWheelCanTurn) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 0.0, 0.0, milliseconds{100});
  wheels[0].angle_rad += 1000.0;
  roll(odometry, 0.0, 0.0, milliseconds{100});
  // Twice 10 m/s for 0.15 s.
  EXPECT_NEAR(odometry.state().covariance.x_x, 3.0 * 3.0 / 3.0 / 4.0, 1e-6);
}

TEST_F(OdometryTest, StartsCertain) {
  const PoseCovariance p = Odometry(vehicle).state().covariance;
  for (const double entry : {p.x_x, p.x_y, p.x_yaw, p.y_y, p.y_yaw, p.yaw_yaw}) {
    EXPECT_EQ(entry, 0.0);
  }
}

TEST_F(OdometryTest, StraightOnItsCovarianceIsKleemansClosedForm) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  const double way_m = 10.0, track_m = vehicle.track_m;
  roll(odometry, way_m, way_m, milliseconds{10'000}, 5000);
  const double q = Odometry::kVariancePerMetre;
  const PoseCovariance& p = odometry.state().covariance;
  EXPECT_NEAR(p.x_x, q * way_m / 2.0, 1e-9);
  EXPECT_NEAR(p.yaw_yaw, 2.0 * q * way_m / (track_m * track_m), 1e-9);
  EXPECT_NEAR(p.y_yaw, q * way_m * way_m / (track_m * track_m), 1e-7);
  EXPECT_NEAR(p.y_y, 2.0 * q * way_m * way_m * way_m / (3.0 * track_m * track_m), 1e-7);
  EXPECT_NEAR(p.x_y, 0.0, 1e-12);
  EXPECT_NEAR(p.x_yaw, 0.0, 1e-12);
}

TEST_F(OdometryTest, TheCovarianceIsInTheWorldsFrame) {
  vehicle.start_yaw_rad = pi / 2;
  Odometry odometry(vehicle);
  odometry.update(wheels);
  roll(odometry, 10.0, 10.0, milliseconds{10'000}, 5000);
  const PoseCovariance& p = odometry.state().covariance;
  EXPECT_NEAR(p.y_y, Odometry::kVariancePerMetre * 10.0 / 2.0, 1e-9);
  EXPECT_NEAR(p.x_x, 100.0 * p.y_y * 4.0 / 3.0 / 1.44, 1e-6);
  EXPECT_LT(p.x_yaw, 0.0) << "turning to the left moves it to smaller x";
}

TEST_F(OdometryTest, ItsCovarianceIsThatOfManyRunsWithWheelsThatErr) {
  // 4000 runs around an S with white errors of k² a metre: variances have a standard deviation of
  // √(2/4000) = 2.2 %, so that 10 % are four and a half.
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const auto way = [](int i) {  // travel of one step: 0.1 m, to the left, then to the right
    const double bend_m = i < 30 ? 0.02 : -0.02;
    return std::array{0.1 - bend_m, 0.1 + bend_m};
  };
  const double q = Odometry::kVariancePerMetre;
  Odometry exact(vehicle);
  exact.update(wheels);
  for (int i = 0; i < 60; ++i) roll(exact, way(i)[0], way(i)[1], milliseconds{100});
  double x_x = 0.0, y_y = 0.0, yaw_yaw = 0.0, x_y = 0.0, y_yaw = 0.0;
  constexpr int kRuns = 4000;
  for (int run = 0; run < kRuns; ++run) {
    Odometry odometry(vehicle);
    odometry.update(wheels);
    for (int i = 0; i < 60; ++i) {
      std::array<double, 2> w = way(i);
      for (double& m : w) m += std::sqrt(q * m) * normal(random);
      roll(odometry, w[0], w[1], milliseconds{100});
    }
    const Pose2 &a = odometry.state().pose, &b = exact.state().pose;
    const double dx = a.x_m - b.x_m, dy = a.y_m - b.y_m, dyaw = a.yaw_rad - b.yaw_rad;
    x_x += dx * dx / kRuns;
    y_y += dy * dy / kRuns;
    yaw_yaw += dyaw * dyaw / kRuns;
    x_y += dx * dy / kRuns;
    y_yaw += dy * dyaw / kRuns;
  }
  const PoseCovariance& p = exact.state().covariance;
  EXPECT_NEAR(p.x_x / x_x, 1.0, 0.1);
  EXPECT_NEAR(p.y_y / y_y, 1.0, 0.1);
  EXPECT_NEAR(p.yaw_yaw / yaw_yaw, 1.0, 0.1);
  EXPECT_NEAR(p.x_y / x_y, 1.0, 0.2);
  EXPECT_NEAR(p.y_yaw / y_yaw, 1.0, 0.1);
}

TEST_F(OdometryTest, AGapMakesItTenTimesAsUncertainAndMoreWhereItTurned) {
  const auto after = [this](Duration between, double right_m) {
    Odometry odometry(vehicle);
    now = kStart;
    wheels[0].angle_rad = wheels[1].angle_rad = 0.0;
    for (WheelFeedback& w : wheels) w.stamp = now;
    odometry.update(wheels);
    roll(odometry, 1.0, right_m, between);
    return odometry.state().covariance;
  };
  const PoseCovariance without = after(Odometry::kGap, 1.0);
  const PoseCovariance with = after(Odometry::kGap + Duration{1}, 1.0);
  EXPECT_NEAR(with.x_x, 10.0 * without.x_x, 1e-12);
  EXPECT_NEAR(with.yaw_yaw, 10.0 * without.yaw_yaw, 1e-12);
  EXPECT_NEAR(with.y_y, 10.0 * without.y_y, 1e-12);
  const PoseCovariance turned = after(milliseconds{300}, 1.12);  // by 0.1 rad over 1.06 m
  const double sideways_m = 1.06 * 0.1 * std::cos(0.05);
  EXPECT_NEAR(turned.y_y - 10.0 * after(Odometry::kGap, 1.12).y_y, sideways_m * sideways_m / 12.0,
              1e-9);
}

TEST_F(OdometryTest, ATimeWithoutValidFeedbackIsAGapHoweverShort) {
  Odometry odometry(vehicle);
  odometry.update(wheels);
  wheels[0].valid = false;
  odometry.update(wheels);
  EXPECT_EQ(odometry.gaps(), 0) << "it lasts";
  wheels[0].valid = true;
  roll(odometry, 0.1, 0.1, milliseconds{20});
  EXPECT_EQ(odometry.gaps(), 1);
  EXPECT_NEAR(odometry.state().covariance.x_x,
              Odometry::kGapFactor * Odometry::kVariancePerMetre * 0.1 / 2.0, 1e-15);
}

TEST_F(OdometryTest, ATurnedStartTurnsTheCovarianceAndNothingElse) {
  const auto bend = [this](double yaw_rad) {
    vehicle.start_yaw_rad = yaw_rad;
    Odometry odometry(vehicle);
    odometry.update(wheels);
    roll(odometry, 4.0, 5.0, milliseconds{5000}, 100);
    return odometry.state().covariance;
  };
  const PoseCovariance p = bend(0.0), q = bend(0.5);
  const double c = std::cos(0.5), s = std::sin(0.5);
  EXPECT_NEAR(q.x_x, c * c * p.x_x - 2.0 * s * c * p.x_y + s * s * p.y_y, 1e-12);
  EXPECT_NEAR(q.x_y, s * c * (p.x_x - p.y_y) + (c * c - s * s) * p.x_y, 1e-12);
  EXPECT_NEAR(q.y_y, s * s * p.x_x + 2.0 * s * c * p.x_y + c * c * p.y_y, 1e-12);
  EXPECT_NEAR(q.x_yaw, c * p.x_yaw - s * p.y_yaw, 1e-12);
  EXPECT_NEAR(q.y_yaw, s * p.x_yaw + c * p.y_yaw, 1e-12);
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
