#pragma once

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "common/world/scan.hpp"
#include "common/world/shape.hpp"
#include "tests/support/shapes.hpp"

namespace tether::test {

/// A scanner without errors for tests: exact rays, 360 beams of a degree each, all at one instant,
/// at the axle's midpoint unless `mount` says otherwise.
struct Scanner {
  Pose2 mount{};
  int beams = 360;
  double first_rad = -std::numbers::pi;
  double step_rad = std::numbers::pi / 180.0;
  double range_m = 25.0;

  Scan scan(Instant when, const Pose2& vehicle, const std::vector<Shape>& shapes) const {
    Scan scan;
    scan.stamp = when;
    scan.mount = mount;
    scan.angle_min_rad = first_rad;
    scan.angle_increment_rad = step_rad;
    scan.range_min_m = 0.02;
    scan.range_max_m = range_m;
    const double c = std::cos(vehicle.yaw_rad), s = std::sin(vehicle.yaw_rad);
    const Position eye{vehicle.x_m + c * mount.x_m - s * mount.y_m,
                       vehicle.y_m + s * mount.x_m + c * mount.y_m};
    std::vector<Position> ways;  // directions of the beams
    for (int i = 0; i < beams; ++i) {
      const double direction =
          vehicle.yaw_rad + mount.yaw_rad + scan.angle_rad(static_cast<std::size_t>(i));
      ways.push_back({std::cos(direction), std::sin(direction)});
    }
    std::vector<double> nearest_m(ways.size(), std::numeric_limits<double>::infinity());
    for (const Shape& shape : shapes) meet(shape, eye, ways, nearest_m);
    for (const double way_m : nearest_m) {
      scan.range_m.push_back(way_m <= range_m ? static_cast<float>(way_m) : 0.0F);
    }
    return scan;
  }

  /// Lowers what a ray in each direction has to go until it enters the shape.
  static void meet(const Shape& shape, const Position& eye, const std::vector<Position>& ways,
                   std::vector<double>& nearest_m) {
    const double c = std::cos(shape.pose.yaw_rad), s = std::sin(shape.pose.yaw_rad);
    const double dx = eye.x_m - shape.pose.x_m, dy = eye.y_m - shape.pose.y_m;
    const Position from{c * dx + s * dy, c * dy - s * dx};  // the eye, in the shape's frame
    for (std::size_t i = 0; i < ways.size(); ++i) {
      const Position way{c * ways[i].x_m + s * ways[i].y_m, c * ways[i].y_m - s * ways[i].x_m};
      const double way_m = shape.outline == Shape::Outline::circle
                               ? into_circle(from, way, shape.radius_m)
                               : into_box(from, way, 0.5 * shape.length_m, 0.5 * shape.width_m);
      nearest_m[i] = std::min(nearest_m[i], way_m);
    }
  }

  static double into_circle(const Position& from, const Position& way, double radius_m) {
    const double b = from.x_m * way.x_m + from.y_m * way.y_m;
    const double root = b * b - (from.x_m * from.x_m + from.y_m * from.y_m - radius_m * radius_m);
    const double way_m = root < 0.0 ? -1.0 : -b - std::sqrt(root);
    return way_m > 0.0 ? way_m : std::numeric_limits<double>::infinity();
  }

  static double into_box(const Position& from, const Position& way, double half_x, double half_y) {
    double enter = 0.0, leave = std::numeric_limits<double>::infinity();
    const auto slab = [&](double at, double step, double half) {
      if (step == 0.0) {
        if (std::abs(at) > half) leave = -1.0;
        return;
      }
      const double a = (-half - at) / step, b = (half - at) / step;
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    };
    slab(from.x_m, way.x_m, half_x);
    slab(from.y_m, way.y_m, half_y);
    return leave >= enter && enter > 0.0 ? enter : std::numeric_limits<double>::infinity();
  }
};

/// Four walls around the origin.
inline std::vector<Shape> hall(double half_m) {
  return {box(half_m + 0.1, 0, 0.2, 2 * half_m), box(-half_m - 0.1, 0, 0.2, 2 * half_m),
          box(0, half_m + 0.1, 2 * half_m, 0.2), box(0, -half_m - 0.1, 2 * half_m, 0.2)};
}

}  // namespace tether::test
