#include "sim/sensor/wheel_odometry.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.hpp"

namespace tether {
namespace {

constexpr std::int64_t kTicks = 50;

double tick_m(const VehicleSettings& vehicle) {
  return 2.0 * std::numbers::pi / static_cast<double>(kTicks) * vehicle.wheel_radius_m;
}

TEST(WheelOdometry, WithTicksIsOffByHalfOfOneAtMostHoweverFarItWent) {
  const VehicleSettings vehicle;
  WheelOdometry odometry(vehicle, kTicks);
  for (int i = 1; i < 20'000; ++i) {
    const double angle_rad = 0.0037 * i;
    odometry.update(angle_rad, angle_rad);
    EXPECT_NEAR(odometry.state().pose.x_m, angle_rad * vehicle.wheel_radius_m,
                0.5 * tick_m(vehicle) + 1e-9);
  }
  EXPECT_EQ(odometry.state().pose.yaw_rad, 0.0);
}

TEST(WheelOdometry, WithoutTicksIsExact) {
  const VehicleSettings vehicle;
  WheelOdometry odometry(vehicle);
  for (int i = 1; i <= 1000; ++i) odometry.update(0.0037 * i, 0.0037 * i);
  EXPECT_NEAR(odometry.state().pose.x_m, 3.7 * vehicle.wheel_radius_m, 1e-9);
}

/// Error from ticks alone, relative to their part of the covariance.
struct Normalised {
  double yaw = 0.0, across = 0.0;
};

Normalised normalised_errors(RandomEngine& random) {
  const VehicleSettings vehicle;
  WheelOdometry exact(vehicle), ticking(vehicle, kTicks);
  double left_rad = 0.0, right_rad = 0.0, left_radps = 0.0, right_radps = 0.0;
  for (int i = 0; i < 1000; ++i) {
    if (i % 100 == 0) {
      left_radps = 2.0 + 2.0 * uniform_01(random);
      right_radps = left_radps + 0.4 * (uniform_01(random) - 0.5);
    }
    left_rad += 0.01 * left_radps;
    right_rad += 0.01 * right_radps;
    exact.update(left_rad, right_rad);
    ticking.update(left_rad, right_rad);
  }
  const DeadReckoning a = exact.state(), b = ticking.state();
  const double dx = b.pose.x_m - a.pose.x_m, dy = b.pose.y_m - a.pose.y_m;
  const double dyaw = b.pose.yaw_rad - a.pose.yaw_rad;
  // Across the chord of the whole drive, where only the yaw's errors lead.
  const double way = std::atan2(a.pose.y_m, a.pose.x_m);
  const double c = -std::sin(way), s = std::cos(way);
  const auto across = [&](const PoseCovariance& p) {
    return c * c * p.x_x + 2.0 * c * s * p.x_y + s * s * p.y_y;
  };
  return {dyaw / std::sqrt(b.covariance.yaw_yaw - a.covariance.yaw_yaw),
          (c * dx + s * dy) / std::sqrt(across(b.covariance) - across(a.covariance))};
}

TEST(WheelOdometry, KnowsHowUncertainTicksMakeIt) {
  RandomEngine random = random_stream(1, "ticks");
  constexpr int kRuns = 2000;
  double yaw = 0.0, across = 0.0;
  for (int i = 0; i < kRuns; ++i) {
    const Normalised z = normalised_errors(random);
    yaw += z.yaw * z.yaw / kRuns;
    across += z.across * z.across / kRuns;
  }
  // The difference of two even errors is triangular, whose square has 1.18 times its mean as
  // standard deviation.
  EXPECT_NEAR(yaw, 1.0, 4.0 * 1.18 / std::sqrt(kRuns));
  // Errors of neighbouring readings within a tick are less correlated than one tick of travel
  // supposes.
  EXPECT_GT(across, 0.4);
  EXPECT_LT(across, 1.2);
}

}  // namespace
}  // namespace tether
