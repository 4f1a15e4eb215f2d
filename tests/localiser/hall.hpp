#pragma once

#include <boost/random/normal_distribution.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <vector>

#include "common/base/random.hpp"
#include "common/vehicle/frames.hpp"
#include "common/world/scan.hpp"
#include "common/world/shape.hpp"
#include "onboard/localiser/censi.hpp"
#include "onboard/localiser/odometry_track.hpp"
#include "tests/support/shapes.hpp"

namespace tether::test {

/// Four walls of 0.5 m around a floor of this size, whose centre is the origin.
inline std::vector<Shape> walls(double length_m, double width_m) {
  const double x_m = 0.5 * length_m + 0.25, y_m = 0.5 * width_m + 0.25;
  return {box(x_m, 0.0, 0.5, width_m + 1.0), box(-x_m, 0.0, 0.5, width_m + 1.0),
          box(0.0, y_m, length_m + 1.0, 0.5), box(0.0, -y_m, length_m + 1.0, 0.5)};
}

/// A hall that looks different from everywhere: racks, a machine at an angle, columns.
inline std::vector<Shape> hall() {
  std::vector<Shape> shapes = walls(30.0, 20.0);
  for (const double y_m : {-6.0, -2.5, 1.0}) shapes.push_back(box(-6.0, y_m, 10.0, 1.2));
  shapes.push_back(box(8.0, 5.0, 3.0, 2.0, 0.5));
  shapes.push_back(box(10.0, -6.0, 2.0, 4.0));
  for (const double x_m : {-10.0, -2.0, 3.0}) shapes.push_back(cylinder(x_m, 6.5, 0.3));
  return shapes;
}

struct Hit {
  double range_m = std::numeric_limits<double>::infinity();
  double normal_rad = 0.0;
};

/// The first outline that a ray meets.
inline Hit cast(const std::vector<Shape>& shapes, const Position& from, double direction_rad) {
  Hit nearest;
  for (const Shape& shape : shapes) {
    const Pose2 local =
        relative_to(shape.pose, {from.x_m, from.y_m, direction_rad});  // in the shape's frame
    const double c = std::cos(local.yaw_rad), s = std::sin(local.yaw_rad);
    const auto meets = [&](double range_m, double normal_rad) {
      if (range_m > 1e-9 && range_m < nearest.range_m) {
        nearest = {range_m, shape.pose.yaw_rad + normal_rad};
      }
    };
    if (shape.outline == Shape::Outline::circle) {
      const double along_m = -(c * local.x_m + s * local.y_m);
      const double beside_m = c * local.y_m - s * local.x_m;
      if (std::abs(beside_m) >= shape.radius_m) continue;
      const double range_m =
          along_m - std::sqrt(shape.radius_m * shape.radius_m - beside_m * beside_m);
      const double outward_rad = std::atan2(local.y_m + range_m * s, local.x_m + range_m * c);
      const double inside_range_m =
          along_m + std::sqrt(shape.radius_m * shape.radius_m - beside_m * beside_m);
      meets(range_m, outward_rad);
      meets(inside_range_m,
            std::atan2(local.y_m + inside_range_m * s, local.x_m + inside_range_m * c));
      continue;
    }
    const double x_m = 0.5 * shape.length_m, y_m = 0.5 * shape.width_m;
    for (const double side : {-1.0, 1.0}) {
      const double to_x_m = (side * x_m - local.x_m) / c, to_y_m = (side * y_m - local.y_m) / s;
      if (std::abs(local.y_m + to_x_m * s) <= y_m) meets(to_x_m, side > 0 ? 0.0 : std::numbers::pi);
      if (std::abs(local.x_m + to_y_m * c) <= x_m) meets(to_y_m, side * 0.5 * std::numbers::pi);
    }
  }
  return nearest;
}

/// A scanner of 541 beams over 270°, 15 turns a second.
struct HallScanner {
  int beams = 541;
  double field_rad = 1.5 * std::numbers::pi;
  double rate_hz = 15.0;
  double range_max_m = 40.0;
  double noise_m = 0.02;
  Pose2 mount{0.4, 0.0, 0.0};

  Scan empty_scan(Instant start, std::int64_t seq) const {
    Scan scan;
    scan.stamp = start;
    scan.seq = seq;
    scan.mount = mount;
    scan.angle_min_rad = -0.5 * field_rad;
    scan.angle_increment_rad = field_rad / (beams - 1);
    scan.time_increment_s = field_rad / (2.0 * std::numbers::pi) / rate_hz / (beams - 1);
    scan.range_min_m = 0.05;
    scan.range_max_m = range_max_m;
    return scan;
  }

  /// Scan of a vehicle that is at `pose_at` each beam's time.
  Scan measure(const std::vector<Shape>& shapes, Instant start, std::int64_t seq,
               const std::function<Pose2(Instant)>& pose_at, RandomEngine& random) const {
    Scan scan = empty_scan(start, seq);
    boost::random::normal_distribution<double> normal;
    for (int i = 0; i < beams; ++i) {
      const auto beam = static_cast<std::size_t>(i);
      const Pose2 from = compose(pose_at(scan.time_of(beam)), mount);
      const Hit hit = cast(shapes, {from.x_m, from.y_m}, from.yaw_rad + scan.angle_rad(beam));
      const double range_m = hit.range_m + noise_m * normal(random);
      scan.range_m.push_back(hit.range_m > range_max_m ? 0.0F : static_cast<float>(range_m));
    }
    return scan;
  }

  Scan measure_standing(const std::vector<Shape>& shapes, const Pose2& pose,
                        RandomEngine& random) const {
    return measure(
        shapes, kStart, 0, [&](Instant) { return pose; }, random);
  }

  /// Upper bound of such a scan's information (censi.hpp).
  PoseInformation bound(const std::vector<Shape>& shapes, const Pose2& pose) const {
    const Scan scan = empty_scan(kStart, 0);
    const Pose2 from = compose(pose, mount);
    std::vector<SeenOutline> seen;
    for (int i = 0; i < beams; ++i) {
      const double direction_rad = from.yaw_rad + scan.angle_rad(static_cast<std::size_t>(i));
      const Hit hit = cast(shapes, {from.x_m, from.y_m}, direction_rad);
      if (hit.range_m <= range_max_m) seen.push_back({direction_rad, hit.range_m, hit.normal_rad});
    }
    return censi_information(seen, noise_m, pose.yaw_rad, mount);
  }
};

inline bool is_free(const std::vector<Shape>& shapes, const Position& place, double margin_m) {
  return std::all_of(shapes.begin(), shapes.end(),
                     [&](const Shape& shape) { return distance_m(shape, place) > margin_m; });
}

/// A place in a rectangle around the origin that is this far from all shapes, and any yaw.
inline Pose2 any_free_pose(const std::vector<Shape>& shapes, double length_m, double width_m,
                           double margin_m, RandomEngine& random) {
  while (true) {
    const Pose2 pose{length_m * (uniform_01(random) - 0.5), width_m * (uniform_01(random) - 0.5),
                     2.0 * std::numbers::pi * (uniform_01(random) - 0.5)};
    if (is_free(shapes, {pose.x_m, pose.y_m}, margin_m)) return pose;
  }
}

}  // namespace tether::test
