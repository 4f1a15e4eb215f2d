#include "sim/plant/true_start.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tether {
namespace {

VehicleSettings uncertain(double error_m, double error_rad) {
  VehicleSettings vehicle;
  vehicle.start_x_m = 2.0;
  vehicle.start_y_m = -3.0;
  vehicle.start_yaw_rad = 0.5;
  vehicle.start_error_m = error_m;
  vehicle.start_error_rad = error_rad;
  return vehicle;
}

VehicleSettings drawn(const VehicleSettings& vehicle, std::uint64_t seed) {
  return at_true_start(vehicle, random_stream(seed, "AGV/start"));
}

TEST(TrueStart, IsTheNominalOneWithoutAnError) {
  const VehicleSettings real = drawn(uncertain(0.0, 0.0), 1);
  EXPECT_EQ(real.start_x_m, 2.0);
  EXPECT_EQ(real.start_y_m, -3.0);
  EXPECT_EQ(real.start_yaw_rad, 0.5);
}

TEST(TrueStart, IsProportionalToTheDeviationOfOneSeed) {
  const VehicleSettings small = drawn(uncertain(0.1, 0.02), 7);
  const VehicleSettings large = drawn(uncertain(0.3, 0.02), 7);
  EXPECT_NEAR(large.start_x_m - 2.0, 3.0 * (small.start_x_m - 2.0), 1e-12);
  EXPECT_NEAR(large.start_y_m + 3.0, 3.0 * (small.start_y_m + 3.0), 1e-12);
  EXPECT_EQ(large.start_yaw_rad, small.start_yaw_rad);
}

TEST(TrueStart, HasTheDeviationOfANormalCutOffAtThreeSigma) {
  constexpr int kSeeds = 20000;
  // Variance of a normal cut off at ±a: σ²(1 − 2 a φ(a) / (2 Φ(a) − 1)), with a = 3.
  const double variance =
      1.0 - 6.0 * std::exp(-4.5) / std::sqrt(2.0 * std::numbers::pi) / 0.99730020393674;
  double sums[3] = {}, squares[3] = {}, largest = 0.0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const VehicleSettings real = drawn(uncertain(0.2, 0.1), seed);
    const double z[3] = {(real.start_x_m - 2.0) / 0.2, (real.start_y_m + 3.0) / 0.2,
                         (real.start_yaw_rad - 0.5) / 0.1};
    for (int k = 0; k < 3; ++k) {
      sums[k] += z[k];
      squares[k] += z[k] * z[k];
      largest = std::max(largest, std::abs(z[k]));
    }
  }
  EXPECT_LE(largest, kStartErrorSigmas + 1e-12);
  EXPECT_GT(largest, 2.9) << "of 60 000 draws 62 are beyond that";
  for (int k = 0; k < 3; ++k) {
    // Standard errors: of the mean σ/√n, of the variance at most σ²·√(2/n). Four of them.
    EXPECT_NEAR(sums[k] / kSeeds, 0.0, 4.0 / std::sqrt(kSeeds));
    EXPECT_NEAR(squares[k] / kSeeds, variance, 4.0 * std::sqrt(2.0 / kSeeds));
  }
}

}  // namespace
}  // namespace tether
