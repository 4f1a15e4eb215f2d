#pragma once

#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// How far it is from each place of a square of floor to what stands there: a grid of cells of
/// kCell_m, exact at their centres, up to kFar_m. Pure.
class FloorMap {
 public:
  static constexpr double kCell_m = 0.1;
  static constexpr double kFar_m = 1.0;

  /// A square of 2 · half_m around `centre`.
  FloorMap(const Position& centre, double half_m);

  void add(const Shape& shape);
  void add(const Position& point);

  /// From a place to the nearest thing, at most kFar_m; negative within one; −kFar_m beyond the
  /// square, for nothing is known there. Between cells' centres it is interpolated.
  double distance_m(const Position& p) const;

 private:
  template <class Distance>
  void lower(double x0, double y0, double x1, double y1, Distance distance);

  double x0_m_, y0_m_;  ///< the square's corner
  int side_;            ///< cells
  std::vector<float> distance_m_;
};

/// The rim of a rectangle around the vehicle, as points in its frame at most 0.2 m apart: what is
/// nowhere nearer to them than c is farther than about c from the rectangle.
std::vector<Position> rim(double rear_m, double front_m, double half_width_m);

/// How far all the points, in the frame of `pose`, are from what stands there.
double gap_m(const FloorMap& floor, const std::vector<Position>& points, const Pose2& pose);

}  // namespace tether
