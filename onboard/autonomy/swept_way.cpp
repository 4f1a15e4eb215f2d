#include "onboard/autonomy/swept_way.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

constexpr double kNever_m = std::numeric_limits<double>::infinity();
/// From this radius on an arc is taken as straight: over 50 m it is off by 1 mm or less.
constexpr double kStraight_m = 1e6;

double straight_way_m(const Position& p, const Outline& outline, double v_mps) {
  if (std::abs(p.y_m) >= outline.half_width_m) return kNever_m;
  const double way_m = v_mps > 0.0 ? p.x_m - outline.front_m : outline.rear_m - p.x_m;
  if (way_m < 0.0) return kNever_m;
  return way_m;
}

/// The smallest angle by which a point at (x, y) has to turn about the origin, clockwise for
/// `clockwise`, to come onto the rectangle's rim; infinity if it never does.
double angle_to_rim(const Position& p, const std::array<double, 2>& xs,
                    const std::array<double, 2>& ys, bool clockwise) {
  const double radius2 = p.x_m * p.x_m + p.y_m * p.y_m;
  const double from = std::atan2(p.y_m, p.x_m);
  double nearest = kNever_m;
  const auto consider = [&](double x, double y) {
    double turn = clockwise ? from - std::atan2(y, x) : std::atan2(y, x) - from;
    if (turn < 0.0) turn += 2.0 * std::numbers::pi;
    nearest = std::min(nearest, turn);
  };
  for (const double x : xs) {
    if (radius2 < x * x) continue;
    const double y = std::sqrt(radius2 - x * x);
    if (y >= ys[0] && y <= ys[1]) consider(x, y);
    if (-y >= ys[0] && -y <= ys[1]) consider(x, -y);
  }
  for (const double y : ys) {
    if (radius2 < y * y) continue;
    const double x = std::sqrt(radius2 - y * y);
    if (x >= xs[0] && x <= xs[1]) consider(x, y);
    if (-x >= xs[0] && -x <= xs[1]) consider(-x, y);
  }
  return nearest;
}

}  // namespace

double Outline::reach_m() const {
  return std::hypot(std::max(std::abs(rear_m), std::abs(front_m)), half_width_m);
}

Outline outline_of(const VehicleConfig& vehicle) {
  const double half_m = 0.5 * vehicle.chassis_length_m;
  const double width_m = std::max(vehicle.chassis_width_m, vehicle.track_m + vehicle.wheel_width_m);
  return {std::min(-half_m - vehicle.axle_x_m, -vehicle.wheel_radius_m),
          std::max(half_m - vehicle.axle_x_m, vehicle.wheel_radius_m), 0.5 * width_m};
}

double pace_mps(const Twist& twist, const Outline& outline) {
  return std::max(std::abs(twist.v_mps), std::abs(twist.omega_radps) * outline.reach_m());
}

double way_until_m(const Position& point, const Outline& outline, const Twist& twist) {
  if (outline.contains(point)) return 0.0;
  const double pace = pace_mps(twist, outline);
  if (pace == 0.0) return kNever_m;
  if (std::abs(twist.omega_radps) * kStraight_m < std::abs(twist.v_mps)) {
    return straight_way_m(point, outline, twist.v_mps);
  }
  const double centre_m = twist.v_mps / twist.omega_radps;
  const std::array<double, 2> xs{outline.rear_m, outline.front_m};
  const std::array<double, 2> ys{-outline.half_width_m - centre_m, outline.half_width_m - centre_m};
  const Position p{point.x_m, point.y_m - centre_m};
  const double farthest_x = std::max(std::abs(xs[0]), std::abs(xs[1]));
  const double farthest_y = std::max(std::abs(ys[0]), std::abs(ys[1]));
  const double nearest_y = ys[0] > 0.0 ? ys[0] : std::max(-ys[1], 0.0);  // the axle is in xs
  const double radius2 = p.x_m * p.x_m + p.y_m * p.y_m;
  if (radius2 > farthest_x * farthest_x + farthest_y * farthest_y) return kNever_m;
  if (radius2 < nearest_y * nearest_y) return kNever_m;
  const double angle_rad = angle_to_rim(p, xs, ys, twist.omega_radps > 0.0);
  return pace * angle_rad / std::abs(twist.omega_radps);
}

bool is_free(const std::vector<Position>& points, const Outline& outline,
             const std::vector<Pose2>& poses) {
  return std::none_of(poses.begin(), poses.end(), [&](const Pose2& pose) {
    const double reach_m = outline.reach_m();
    const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
    return std::any_of(points.begin(), points.end(), [&](const Position& p) {
      const double dx = p.x_m - pose.x_m, dy = p.y_m - pose.y_m;
      return std::abs(dx) < reach_m && std::abs(dy) < reach_m &&
             outline.contains({c * dx + s * dy, c * dy - s * dx});
    });
  });
}

Position from_frame(const Pose2& pose, const Position& p) {
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  return {pose.x_m + c * p.x_m - s * p.y_m, pose.y_m + s * p.x_m + c * p.y_m};
}

Position into_frame(const Pose2& pose, const Position& p) {
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  const double dx = p.x_m - pose.x_m, dy = p.y_m - pose.y_m;
  return {c * dx + s * dy, c * dy - s * dx};
}

Pose2 moved(const Pose2& from, const Twist& twist, double dt_s) {
  return along_arc(from, twist.v_mps * dt_s, twist.omega_radps * dt_s);
}

}  // namespace tether
