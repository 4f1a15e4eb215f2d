#include "common/vehicle/dead_reckoning.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

namespace tether {
namespace {

constexpr double kTrack_m = 1.2;

TEST(DeadReckoning, IsExactOnArcs) {
  DeadReckoning quarter{{1.0, 2.0, 0.0}, {}, 0.0};
  const double half_pi = std::numbers::pi / 2;
  quarter.move({half_pi * (3.0 - 0.6), half_pi * (3.0 + 0.6)},
               kTrack_m);  // to the left, radius 3 m
  EXPECT_NEAR(quarter.pose.x_m, 4.0, 1e-12);
  EXPECT_NEAR(quarter.pose.y_m, 5.0, 1e-12);
  EXPECT_NEAR(quarter.pose.yaw_rad, half_pi, 1e-12);
  EXPECT_NEAR(quarter.distance_m, half_pi * 3.0, 1e-12);
}

TEST(DeadReckoning, CountsTheWayBackAsWayToo) {
  DeadReckoning there_and_back;
  there_and_back.move({2.0, 2.0}, kTrack_m);
  there_and_back.move({-2.0, -2.0}, kTrack_m);
  EXPECT_EQ(there_and_back.pose.x_m, 0.0);
  EXPECT_EQ(there_and_back.distance_m, 4.0);
}

/// The pose after a way of both wheels, from a pose and with errors of everything.
Pose2 after(const Pose2& pose, double left_m, double right_m) {
  DeadReckoning reckoning{pose, {}, 0.0};
  reckoning.move({left_m, right_m}, kTrack_m);
  return reckoning.pose;
}

TEST(DeadReckoning, CovarianceIsThatOfTheDifferentiatedMotion) {
  const Pose2 pose{1.0, -2.0, 0.7};
  constexpr double kLeft_m = 0.03, kRight_m = 0.05, kStep = 1e-6;
  PoseCovariance before;
  before.add(0.5, -0.2, 0.1, 0.04);
  before.add(0.1, 0.7, -0.3, 0.09);
  DeadReckoning reckoning{pose, before, 0.0};
  reckoning.move({kLeft_m, kRight_m, 0.01, 0.02}, kTrack_m);

  // Both covariances are sums of errors along directions; each direction's image by differences.
  const Pose2 end = after(pose, kLeft_m, kRight_m);
  PoseCovariance expected;
  const auto add_image = [&](const Pose2& moved, double variance) {
    expected.add((moved.x_m - end.x_m) / kStep, (moved.y_m - end.y_m) / kStep,
                 (moved.yaw_rad - end.yaw_rad) / kStep, variance);
  };
  const auto shifted = [&](double x, double y, double yaw) {
    return after({pose.x_m + kStep * x, pose.y_m + kStep * y, pose.yaw_rad + kStep * yaw}, kLeft_m,
                 kRight_m);
  };
  add_image(shifted(0.5, -0.2, 0.1), 0.04);
  add_image(shifted(0.1, 0.7, -0.3), 0.09);
  add_image(after(pose, kLeft_m + kStep, kRight_m), 0.01);
  add_image(after(pose, kLeft_m, kRight_m + kStep), 0.02);
  const PoseCovariance& p = reckoning.covariance;
  // To first order in the turn within the step: the chord's length is taken as the arc's.
  constexpr double kTolerance = 1e-6;
  EXPECT_NEAR(p.x_x, expected.x_x, kTolerance);
  EXPECT_NEAR(p.x_y, expected.x_y, kTolerance);
  EXPECT_NEAR(p.x_yaw, expected.x_yaw, kTolerance);
  EXPECT_NEAR(p.y_y, expected.y_y, kTolerance);
  EXPECT_NEAR(p.y_yaw, expected.y_yaw, kTolerance);
  EXPECT_NEAR(p.yaw_yaw, expected.yaw_yaw, kTolerance);
}

}  // namespace
}  // namespace tether
