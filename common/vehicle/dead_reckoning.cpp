#include "common/vehicle/dead_reckoning.hpp"

#include <cmath>

namespace tether {
namespace {

/// sin(x)/x
double sinc(double x) {
  // Below this, 1 − x²/6 is exact to the last bit.
  return std::abs(x) < 1e-4 ? 1.0 - x * x / 6.0 : std::sin(x) / x;
}

/// The covariance of a pose that moved by (dx, dy) in the world's frame: F P Fᵀ, where F is the
/// identity but for the derivatives of x and y by the yaw, −dy and dx.
PoseCovariance moved(const PoseCovariance& p, double dx_m, double dy_m) {
  const double a = -dy_m, b = dx_m;
  return {p.x_x + 2.0 * a * p.x_yaw + a * a * p.yaw_yaw,
          p.x_y + a * p.y_yaw + b * p.x_yaw + a * b * p.yaw_yaw,
          p.x_yaw + a * p.yaw_yaw,
          p.y_y + 2.0 * b * p.y_yaw + b * b * p.yaw_yaw,
          p.y_yaw + b * p.yaw_yaw,
          p.yaw_yaw};
}

}  // namespace

void PoseCovariance::add(double x, double y, double yaw, double variance) {
  x_x += x * x * variance;
  x_y += x * y * variance;
  x_yaw += x * yaw * variance;
  y_y += y * y * variance;
  y_yaw += y * yaw * variance;
  yaw_yaw += yaw * yaw * variance;
}

DeadReckoning::Step DeadReckoning::move(const RolledWays& ways, double track_m) {
  const double arc_m = (ways.left_m + ways.right_m) / 2.0;
  const double turn_rad = (ways.right_m - ways.left_m) / track_m;
  const double chord_m = arc_m * sinc(turn_rad / 2.0);
  const double direction_rad = pose.yaw_rad + turn_rad / 2.0;
  const double dx_m = chord_m * std::cos(direction_rad);
  const double dy_m = chord_m * std::sin(direction_rad);

  covariance = moved(covariance, dx_m, dy_m);
  const auto add_wheel = [&](double yaw_per_m, double variance_m2) {
    // Derivatives by this wheel's way: half of it moves the midpoint, and it turns the chord.
    covariance.add(std::cos(direction_rad) / 2.0 - dy_m * yaw_per_m / 2.0,
                   std::sin(direction_rad) / 2.0 + dx_m * yaw_per_m / 2.0, yaw_per_m, variance_m2);
  };
  add_wheel(-1.0 / track_m, ways.left_variance_m2);
  add_wheel(1.0 / track_m, ways.right_variance_m2);

  pose.x_m += dx_m;
  pose.y_m += dy_m;
  pose.yaw_rad = wrap_angle(pose.yaw_rad + turn_rad);
  distance_m += std::abs(arc_m);
  return {arc_m, turn_rad, direction_rad};
}

}  // namespace tether
