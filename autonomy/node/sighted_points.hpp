#pragma once

#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// Unmapped obstacles of a scan: the points around the vehicle that are
/// not in the map, thinned out. Pure.
class SightedPoints {
 public:
  static constexpr double kRange_m = 8.0;   ///< from the axle's midpoint
  static constexpr double kMapped_m = 0.2;  ///< points nearer to a mapped shape belong to it
  static constexpr double kApart_m = 0.1;   ///< one point for each cell of this size

  /// `mapped`: all that the map has.
  explicit SightedPoints(const std::vector<Shape>& mapped);

  /// `points` in the vehicle's frame; the answer in the world's, at most `most`, the nearest first.
  std::vector<Position> unmapped(const std::vector<Position>& points, const Pose2& vehicle,
                                 std::size_t most) const;

 private:
  struct Known {
    Shape shape;
    double reach_m;  ///< from its centre
  };
  bool is_mapped(const Position& p) const;

  std::vector<Known> known_;
};

}  // namespace tether
