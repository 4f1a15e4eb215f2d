#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/path/simple_curves.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {
namespace {

constexpr double kPeriod_s = 20.0 * std::numbers::pi;  // 62.83 s at 0.1 rad/s
const FigureEight kPaper{FigureEight::Config{}};

/// Central difference over 2 ms: exact to 1e-8 m/s here.
PathPoint velocity(double t_s) {
  const auto before = kPaper.at(t_s - 1e-3), after = kPaper.at(t_s + 1e-3);
  PathPoint v;
  v.x_m = (after.x_m - before.x_m) / 2e-3;
  v.y_m = (after.y_m - before.y_m) / 2e-3;
  return v;
}

TEST(FigureEight, StartsAtTheOriginParallelToX) {
  EXPECT_EQ(kPaper.at(0.0).x_m, 0.0);
  EXPECT_EQ(kPaper.at(0.0).y_m, 0.0);
  EXPECT_NEAR(velocity(0.0).y_m, 0.0, 1e-6);
  EXPECT_GT(velocity(0.0).x_m, 0.0);
}

TEST(FigureEight, PassesTheCentreAt2Point83MetresPerSecond) {
  for (const double t_s : {0.0, kPeriod_s / 2.0}) {
    EXPECT_NEAR(std::hypot(velocity(t_s).x_m, velocity(t_s).y_m), 2.0 * std::numbers::sqrt2, 1e-6);
  }
}

TEST(FigureEight, ItsTwistIsTheDerivativeOfItsPoints) {
  for (double t_s = -10.0; t_s < 70.0; t_s += 0.7) {
    const PathPoint point = kPaper.at(t_s);
    const PathPoint v = velocity(t_s);
    EXPECT_NEAR(point.v_mps, std::hypot(v.x_m, v.y_m), 1e-6) << t_s;
    EXPECT_NEAR(wrap_angle(point.yaw_rad - std::atan2(v.y_m, v.x_m)), 0.0, 1e-6) << t_s;
    const double turned = wrap_angle(kPaper.at(t_s + 1e-3).yaw_rad - kPaper.at(t_s - 1e-3).yaw_rad);
    EXPECT_NEAR(point.omega_radps, turned / 2e-3, 1e-6) << t_s;
  }
}

TEST(FigureEight, ItsPositionAloneIsTheSame) {
  for (double t_s = -10.0; t_s < 70.0; t_s += 0.7) {
    EXPECT_EQ(kPaper.position_at(t_s).x_m, kPaper.at(t_s).x_m);
    EXPECT_EQ(kPaper.position_at(t_s).y_m, kPaper.at(t_s).y_m);
  }
}

TEST(FigureEight, TakesOnePeriodAndPassesTheOriginInTheMiddle) {
  for (const double t_s : {0.0, 7.0, 31.0, -5.0}) {
    EXPECT_NEAR(kPaper.at(t_s + kPeriod_s).x_m, kPaper.at(t_s).x_m, 1e-12);
    EXPECT_NEAR(kPaper.at(t_s + kPeriod_s).y_m, kPaper.at(t_s).y_m, 1e-12);
  }
  EXPECT_NEAR(std::hypot(kPaper.at(kPeriod_s / 2).x_m, kPaper.at(kPeriod_s / 2).y_m), 0.0, 1e-12);
}

TEST(FigureEight, FollowsTheClosedForm) {
  for (double t_s = -10.0; t_s < 70.0; t_s += 0.7) {
    const double u = 20.0 * std::sin(0.1 * t_s);
    const double w = 20.0 * std::sin(0.1 * t_s) * std::cos(0.1 * t_s);
    EXPECT_NEAR(kPaper.at(t_s).x_m, (u + w) / std::numbers::sqrt2, 1e-12) << t_s;
    EXPECT_NEAR(kPaper.at(t_s).y_m, (w - u) / std::numbers::sqrt2, 1e-12) << t_s;
  }
}

TEST(FigureEight, TurnsItsTipToMinus45Degrees) {
  // theta = pi/2: u = 20 m, w = 0.
  const auto tip = kPaper.at(kPeriod_s / 4.0);
  EXPECT_NEAR(tip.x_m, 20.0 / std::numbers::sqrt2, 1e-12);
  EXPECT_NEAR(tip.y_m, -20.0 / std::numbers::sqrt2, 1e-12);
}

TEST(FigureEight, Reaches18Point37MetresOnBothAxes) {
  double x_m = 0.0, y_m = 0.0;
  for (double t_s = 0.0; t_s < kPeriod_s; t_s += 1e-3) {
    x_m = std::max(x_m, std::abs(kPaper.at(t_s).x_m));
    y_m = std::max(y_m, std::abs(kPaper.at(t_s).y_m));
  }
  // d/dtheta of sin theta (1 + cos theta) vanishes at theta = 60 degrees.
  const double reach = 20.0 / std::numbers::sqrt2 * 0.75 * std::numbers::sqrt3;
  EXPECT_NEAR(reach, 18.37, 0.005);
  EXPECT_NEAR(x_m, reach, 1e-5);
  EXPECT_NEAR(y_m, reach, 1e-5);
}

TEST(FigureEight, ScalesTurnsAndHurriesAsConfigured) {
  const FigureEight upright({.amplitude_m = 2.0, .rate_radps = 1.0, .rotation_rad = 0.0});
  EXPECT_NEAR(upright.at(std::numbers::pi / 2.0).x_m, 2.0, 1e-12);
  EXPECT_NEAR(upright.at(std::numbers::pi / 2.0).y_m, 0.0, 1e-12);
  EXPECT_NEAR(upright.at(std::numbers::pi / 4.0).y_m, 1.0, 1e-12);
}

}  // namespace
}  // namespace tether
