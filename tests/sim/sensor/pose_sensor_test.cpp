#include "sim/sensor/pose_sensor.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <vector>

namespace tether {
namespace {

TEST(PoseSensor, WithoutNoiseIsTheTruth) {
  PoseSensor sensor({}, 1, "AGV");
  const Pose2 p = sensor.measure({1.0, 2.0, 3.0}).value();
  EXPECT_EQ(p.x_m, 1.0);
  EXPECT_EQ(p.y_m, 2.0);
  EXPECT_EQ(p.yaw_rad, 3.0);
}

TEST(PoseSensor, NoiseHasTheConfiguredDeviationAndNoBias) {
  constexpr int kSamples = 20000;
  SensorSettings config;
  config.position_noise_m = 0.02;
  config.yaw_noise_rad = 0.01;
  PoseSensor sensor(config, 1, "AGV");
  double sum[3] = {}, squares[3] = {};
  for (int i = 0; i < kSamples; ++i) {
    const Pose2 p = sensor.measure({}).value();
    const double value[3] = {p.x_m, p.y_m, p.yaw_rad};
    for (int k = 0; k < 3; ++k) {
      sum[k] += value[k];
      squares[k] += value[k] * value[k];
    }
  }
  const double sigma[3] = {0.02, 0.02, 0.01};
  for (int k = 0; k < 3; ++k) {
    // Standard errors: of the mean σ/√n, of σ itself about σ/√(2n). Four of them.
    EXPECT_NEAR(sum[k] / kSamples, 0.0, 4.0 * sigma[k] / std::sqrt(kSamples));
    EXPECT_NEAR(std::sqrt(squares[k] / kSamples), sigma[k],
                4.0 * sigma[k] / std::sqrt(2.0 * kSamples));
  }
}

TEST(PoseSensor, DriftGrowsWithTheRootOfTime) {
  SensorSettings config;
  config.rate_hz = 4.0;
  config.position_drift_mpsqrts = 0.1;
  config.yaw_drift_radpsqrts = 0.02;
  double squares_m2 = 0.0, squares_rad2 = 0.0;
  constexpr int kSensors = 1000;
  constexpr double kTime_s = 9.0;
  for (std::uint64_t seed = 1; seed <= kSensors; ++seed) {
    PoseSensor sensor(config, seed, "AGV");
    Pose2 pose = sensor.measure({}).value();
    EXPECT_EQ(pose.x_m, 0.0) << "it begins with the truth";
    for (int i = 0; i < 4 * static_cast<int>(kTime_s); ++i) pose = sensor.measure({}).value();
    squares_m2 += pose.x_m * pose.x_m + pose.y_m * pose.y_m;
    squares_rad2 += pose.yaw_rad * pose.yaw_rad;
  }
  // A sum of n squares of normals has the relative deviation sqrt(2/n): 3.2 % and 4.5 %; three of
  // them.
  EXPECT_NEAR(squares_m2 / (2 * kSensors) / (0.01 * kTime_s), 1.0, 3.0 * 0.032);
  EXPECT_NEAR(squares_rad2 / kSensors / (0.0004 * kTime_s), 1.0, 3.0 * 0.045);
}

TEST(PoseSensor, NoisyYawStaysWrapped) {
  SensorSettings config;
  config.yaw_noise_rad = 0.5;
  PoseSensor sensor(config, 1, "AGV");
  for (int i = 0; i < 1000; ++i) {
    EXPECT_LE(std::abs(sensor.measure({0.0, 0.0, 3.14}).value().yaw_rad), 3.1415926535897936);
  }
}

TEST(PoseSensor, CorrelatedNoiseIsAsLargeAsWhiteAndForgetsExponentially) {
  SensorSettings config;
  config.rate_hz = 20.0;
  config.position_noise_m = 0.1;
  config.noise_correlation_s = 0.5;
  constexpr int kSensors = 4000, kLater = 10;  // 0.5 s: correlation 1/e
  double first = 0.0, last = 0.0, product = 0.0;
  for (std::uint64_t seed = 1; seed <= kSensors; ++seed) {
    PoseSensor sensor(config, seed, "AGV");
    const double x0 = sensor.measure({}).value().x_m / 0.1;
    double x = x0;
    for (int i = 0; i < kLater; ++i) x = sensor.measure({}).value().x_m / 0.1;
    first += x0 * x0;
    last += x * x;
    product += x0 * x;
  }
  // Standard errors: of a variance √(2/n); of the product's mean √((1 + ρ²)/n). Four of them.
  const double rho = std::exp(-1.0), n = kSensors;
  EXPECT_NEAR(first / n, 1.0, 4.0 * std::sqrt(2.0 / n)) << "stationary from the first on";
  EXPECT_NEAR(last / n, 1.0, 4.0 * std::sqrt(2.0 / n));
  EXPECT_NEAR(product / n, rho, 4.0 * std::sqrt((1.0 + rho * rho) / n));
}

TEST(PoseSensor, BiasIsAlwaysTheSame) {
  SensorSettings config;
  config.bias_x_m = 0.2;
  config.bias_y_m = -0.1;
  config.bias_yaw_rad = 0.3;
  PoseSensor sensor(config, 1, "AGV");
  for (int i = 0; i < 10; ++i) {
    const Pose2 p = sensor.measure({1.0, 2.0, 3.0}).value();
    EXPECT_NEAR(p.x_m, 1.2, 1e-15);
    EXPECT_NEAR(p.y_m, 1.9, 1e-15);
    EXPECT_NEAR(p.yaw_rad, wrap_angle(3.3), 1e-15);
  }
}

SensorSettings jumping() {
  SensorSettings config;
  config.rate_hz = 20.0;
  config.jumps_per_min = 6.0;
  config.jump_m = 0.4;
  config.jump_rad = 0.05;
  return config;
}

TEST(LocalisationJumps, ComeAsAPoissonProcessAndHoldUntilTheNext) {
  PoseSensor sensor(jumping(), 1, "AGV");
  constexpr double kTime_s = 36000.0;
  int jumps = 0;
  double squares_m2 = 0.0, squares_rad2 = 0.0;
  Pose2 last = sensor.measure({}).value();
  EXPECT_EQ(last.x_m, 0.0) << "it begins at the right place";
  for (int i = 0; i < static_cast<int>(kTime_s * 20.0); ++i) {
    const Pose2 p = sensor.measure({}).value();
    if (p.x_m == last.x_m) continue;
    ++jumps;
    squares_m2 += p.x_m * p.x_m + p.y_m * p.y_m;
    squares_rad2 += p.yaw_rad * p.yaw_rad;
    last = p;
  }
  // One every 10 s: 3600 ± 60. Of 1 in 200 jumps the next follows before a measurement sees it.
  const double expected = kTime_s / 10.0;
  EXPECT_NEAR(jumps, expected * (1.0 - 0.005), 4.0 * std::sqrt(expected));
  const double n = jumps;
  EXPECT_NEAR(squares_m2 / (2.0 * n) / 0.16, 1.0, 4.0 * std::sqrt(1.0 / n));
  EXPECT_NEAR(squares_rad2 / n / 0.0025, 1.0, 4.0 * std::sqrt(2.0 / n));
}

TEST(LocalisationJumps, OfADurationPassAway) {
  SensorSettings config = jumping();
  config.jump_s = 2.0;
  PoseSensor sensor(config, 1, "AGV");
  constexpr double kTime_s = 36000.0;
  int off = 0;
  for (int i = 0; i < static_cast<int>(kTime_s * 20.0); ++i) {
    if (sensor.measure({}).value().x_m != 0.0) ++off;
  }
  // It is off if there was a jump in the last 2 s, of one every 10 s: 1 − exp(−0.2). By the theory
  // of such coverage its time share over T has a variance below 2 · 2 s / T.
  EXPECT_NEAR(off / (kTime_s * 20.0), 1.0 - std::exp(-0.2), 4.0 * std::sqrt(4.0 / kTime_s));
}

SensorSettings dropping() {
  SensorSettings config;
  config.rate_hz = 20.0;
  config.dropouts_per_min = 12.0;
  config.dropout_s = 3.0;
  return config;
}

TEST(Dropouts, TakeTheShareOfTheirDuration) {
  PoseSensor sensor(dropping(), 1, "AGV");
  EXPECT_TRUE(sensor.measure({}).has_value()) << "it begins with poses";
  constexpr double kTime_s = 36000.0, kUp_s = 5.0, kDown_s = 3.0;
  int missing = 0, begun = 0;
  bool before = false;
  for (int i = 0; i < static_cast<int>(kTime_s * 20.0); ++i) {
    const bool now = !sensor.measure({}).has_value();
    if (now) ++missing;
    if (now && !before) ++begun;
    before = now;
  }
  // The share over T of an alternating renewal process with exponential times u and d has the
  // variance 2 u² d² / ((u + d)³ T).
  const double cycle_s = kUp_s + kDown_s;
  const double deviation =
      std::sqrt(2.0 * kUp_s * kUp_s * kDown_s * kDown_s / (std::pow(cycle_s, 3) * kTime_s));
  EXPECT_NEAR(missing / (kTime_s * 20.0), kDown_s / cycle_s, 4.0 * deviation);
  // Cycles: their variance is T (u² + d²)/(u + d)³. Those shorter than a period may not be seen: 1
  // in 60 dropouts, and 1 in 100 of the gaps between them.
  const double cycles = kTime_s / cycle_s;
  EXPECT_NEAR(
      begun, cycles * (1.0 - 0.5 / 60.0 - 0.5 / 100.0),
      4.0 * std::sqrt(kTime_s * (kUp_s * kUp_s + kDown_s * kDown_s) / std::pow(cycle_s, 3)));
}

TEST(PoseSensor, ErrorsDependOnTheSeedAndTheNumberOfTheMeasurementOnly) {
  SensorSettings quiet;
  quiet.position_noise_m = 0.1;
  quiet.yaw_noise_rad = 0.1;
  quiet.position_drift_mpsqrts = 0.1;
  SensorSettings eventful = quiet;
  eventful.dropouts_per_min = 12.0;
  eventful.jumps_per_min = 12.0;
  eventful.jump_s = 1.0;
  PoseSensor one(quiet, 3, "AGV"), other(eventful, 3, "AGV");
  int same = 0;
  for (int i = 0; i < 1000; ++i) {
    const Pose2 p = one.measure({}).value();
    const std::optional<Pose2> q = other.measure({0.0, 0.0, 0.0});
    if (!q || q->x_m != p.x_m) continue;
    EXPECT_EQ(q->y_m, p.y_m);
    EXPECT_EQ(q->yaw_rad, p.yaw_rad);
    ++same;
  }
  EXPECT_GT(same, 300);
  EXPECT_LT(same, 1000);
}

}  // namespace
}  // namespace tether
