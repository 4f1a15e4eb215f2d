#pragma once

#include <array>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Something that stands on the floor, seen from above: what scanners see and vehicles touch.
struct Shape {
  enum class Outline { rectangle, circle };
  Outline outline = Outline::rectangle;
  Pose2 pose = {};         ///< pose of its centre, world frame
  double length_m = 1.0;   ///< rectangle: along the pose's x axis
  double width_m = 1.0;    ///< rectangle: along its y axis
  double radius_m = 0.5;   ///< circle
  double height_m = 2.0;   ///< height of its top above the floor
  double clearance_m = 0;  ///< height of its lower side above the floor; 0 except for shelves
  /// Share of a scanner's light that comes back, diffusely, at normal incidence; 0 … 1.
  double reflectivity = 0.5;
  // Its motion, world frame; 0: it stands.
  double vx_mps = 0.0;
  double vy_mps = 0.0;

  /// Whether there is something of it so far above the floor.
  bool is_at(double height) const { return clearance_m <= height && height <= height_m; }
};

/// One side of a rectangle.
struct Segment {
  Position from, to;
};

/// The four corners of a rectangle, counter-clockwise.
std::array<Position, 4> corners(const Shape& rectangle);

/// From a point to the shape's outline; negative inside.
double distance_m(const Shape& shape, const Position& point);

/// Between two outlines; where they overlap, minus how far one must move to come free.
double gap_m(const Shape& a, const Shape& b);

/// A vehicle as it meets obstacles: the chassis, and both wheels with what is between them. All of
/// its height counts.
using Footprint = std::array<Shape, 2>;

/// Its axle's midpoint at `axle`.
Footprint footprint(const VehicleConfig& vehicle, const Pose2& axle);

/// The least one.
double gap_m(const Footprint& a, const Footprint& b);

/// From a point of the vehicle's x axis, the axle at 0, to what is farthest away of its footprint.
double reach_m(const VehicleConfig& vehicle, double x_m = 0.0);

}  // namespace tether
