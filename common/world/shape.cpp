#include "common/world/shape.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tether {
namespace {

/// The point in the pose's frame.
Position seen_from(const Pose2& pose, const Position& p) {
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  const double x = p.x_m - pose.x_m, y = p.y_m - pose.y_m;
  return {c * x + s * y, c * y - s * x};
}

/// Along the normal of that side of `a` which keeps `b` farthest away: 0 or more if it parts them.
double parted_m(const Shape& a, const std::array<Position, 4>& b) {
  Position low{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  Position high{-low.x_m, -low.y_m};
  for (const Position& corner : b) {
    const Position p = seen_from(a.pose, corner);
    low = {std::min(low.x_m, p.x_m), std::min(low.y_m, p.y_m)};
    high = {std::max(high.x_m, p.x_m), std::max(high.y_m, p.y_m)};
  }
  return std::max(std::max(low.x_m, -high.x_m) - 0.5 * a.length_m,
                  std::max(low.y_m, -high.y_m) - 0.5 * a.width_m);
}

double nearest_corner_m(const Shape& shape, const std::array<Position, 4>& of_other) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Position& corner : of_other) nearest = std::min(nearest, distance_m(shape, corner));
  return nearest;
}

}  // namespace

std::array<Position, 4> corners(const Shape& rectangle) {
  const Pose2& pose = rectangle.pose;
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  const double x = 0.5 * rectangle.length_m, y = 0.5 * rectangle.width_m;
  const auto at = [&](double ahead, double left) {
    return Position{pose.x_m + c * ahead - s * left, pose.y_m + s * ahead + c * left};
  };
  return {at(x, y), at(-x, y), at(-x, -y), at(x, -y)};
}

double distance_m(const Shape& shape, const Position& point) {
  if (shape.outline == Shape::Outline::circle) {
    return std::hypot(point.x_m - shape.pose.x_m, point.y_m - shape.pose.y_m) - shape.radius_m;
  }
  const Position p = seen_from(shape.pose, point);
  const double x = std::abs(p.x_m) - 0.5 * shape.length_m;
  const double y = std::abs(p.y_m) - 0.5 * shape.width_m;
  if (x > 0.0 && y > 0.0) return std::hypot(x, y);
  return std::max(x, y);
}

double gap_m(const Shape& a, const Shape& b) {
  if (a.outline == Shape::Outline::circle) {
    return distance_m(b, {a.pose.x_m, a.pose.y_m}) - a.radius_m;
  }
  if (b.outline == Shape::Outline::circle) return gap_m(b, a);
  const auto of_a = corners(a), of_b = corners(b);
  const double parted = std::max(parted_m(a, of_b), parted_m(b, of_a));
  if (parted <= 0.0) return parted;
  return std::min(nearest_corner_m(a, of_b), nearest_corner_m(b, of_a));
}

Footprint footprint(const VehicleConfig& vehicle, const Pose2& axle) {
  const double c = std::cos(axle.yaw_rad), s = std::sin(axle.yaw_rad);
  Shape chassis{
      .pose = {axle.x_m - c * vehicle.axle_x_m, axle.y_m - s * vehicle.axle_x_m, axle.yaw_rad},
      .length_m = vehicle.chassis_length_m,
      .width_m = vehicle.chassis_width_m};
  chassis.height_m = vehicle.wheel_radius_m + vehicle.chassis_z_m + 0.5 * vehicle.chassis_height_m;
  Shape wheels{.pose = axle,
               .length_m = 2.0 * vehicle.wheel_radius_m,
               .width_m = vehicle.track_m + vehicle.wheel_width_m};
  wheels.height_m = 2.0 * vehicle.wheel_radius_m;
  return {chassis, wheels};
}

double gap_m(const Footprint& a, const Footprint& b) {
  double least = std::numeric_limits<double>::infinity();
  for (const Shape& of_a : a) {
    for (const Shape& of_b : b) least = std::min(least, gap_m(of_a, of_b));
  }
  return least;
}

double reach_m(const VehicleConfig& vehicle, double x_m) {
  double farthest = 0.0;
  for (const Shape& part : footprint(vehicle, {})) {
    for (const Position& p : corners(part)) {
      farthest = std::max(farthest, std::hypot(p.x_m - x_m, p.y_m));
    }
  }
  return farthest;
}

}  // namespace tether
