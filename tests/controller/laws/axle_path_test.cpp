#include "controller/laws/axle_path.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "common/path/controlled_point.hpp"
#include "common/path/kinds.hpp"

namespace tether {
namespace {

constexpr double kAhead_m = 0.5;

std::shared_ptr<const ReferencePath> figure_eight() { return make_path(PathSettings{}); }

TEST(AxlePath, TheAxlesPathTakesThePointAlongTheOther) {
  const auto path = figure_eight();
  const AxlePath axle_path(path, kAhead_m);
  for (double t_s = 0.0; t_s < 60.0; t_s += 0.37) {
    const PathPoint axle = axle_path.at(t_s);
    const Position point = point_ahead({axle.x_m, axle.y_m, axle.yaw_rad}, kAhead_m);
    EXPECT_NEAR(point.x_m, path->at(t_s).x_m, 1e-9);
    EXPECT_NEAR(point.y_m, path->at(t_s).y_m, 1e-9);
  }
}

TEST(AxlePath, TheAxleNeverSlipsSideways) {
  const AxlePath axle_path(figure_eight(), kAhead_m);
  constexpr double kStep_s = 1e-3;
  for (double t_s = 0.05; t_s < 60.0; t_s += 0.37) {
    const PathPoint before = axle_path.at(t_s - kStep_s), p = axle_path.at(t_s),
                    after = axle_path.at(t_s + kStep_s);
    const double vx = (after.x_m - before.x_m) / (2 * kStep_s);
    const double vy = (after.y_m - before.y_m) / (2 * kStep_s);
    const double c = std::cos(p.yaw_rad), s = std::sin(p.yaw_rad);
    // A heading is off by at most step²/8 · |d²θ/dt²|, 1e-5 rad, between two steps of 10 ms.
    EXPECT_NEAR(c * vy - s * vx, 0.0, 1e-2);
    EXPECT_NEAR(c * vx + s * vy, p.v_mps, 1e-3);
    EXPECT_NEAR(wrap_angle(after.yaw_rad - before.yaw_rad) / (2 * kStep_s), p.omega_radps, 1e-2);
  }
}

TEST(AxlePath, OnACircleTheAxleRunsInsideAndTrails) {
  PathSettings circle;
  circle.kind = "circle";
  circle.radius_m = 4.0;
  const auto path = make_path(circle);
  const PathPoint p = path->at(15.0), axle = AxlePath(path, kAhead_m).at(15.0);
  EXPECT_NEAR(wrap_angle(p.yaw_rad - axle.yaw_rad), std::asin(kAhead_m / 4.0), 1e-4);
  EXPECT_NEAR(axle.omega_radps, p.omega_radps, 1e-4);
  EXPECT_NEAR(axle.v_mps / axle.omega_radps, std::sqrt(16.0 - 0.25), 1e-3);
}

TEST(AxlePath, AnswersDoNotDependOnWhatWasAskedBefore) {
  const AxlePath once(figure_eight(), kAhead_m), often(figure_eight(), kAhead_m);
  for (double t_s = -30.0; t_s < 40.0; t_s += 0.1) often.at(t_s);
  EXPECT_EQ(once.at(33.333).yaw_rad, often.at(33.333).yaw_rad);
}

}  // namespace
}  // namespace tether
