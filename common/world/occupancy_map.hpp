#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/vehicle/pose.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// A map of cells as map_server of ROS and Nav2 has it: a YAML file with
///
///     image: hall.pgm          # relative to the YAML file
///     resolution: 0.05         # metres a cell
///     origin: [-30, -20, 0]    # x, y and yaw of the lower left corner of the lower left cell
///     negate: 0                # 1: white is occupied
///     occupied_thresh: 0.65
///     free_thresh: 0.25
///     mode: trinary            # may be left out; others are refused
///
/// and a PGM image, P2 or P5, of 8 or 16 bit, whose first row is the farthest from the origin. A
/// pixel of brightness b in [0, 1] is occupied if 1 − b (with negate: b) is above occupied_thresh;
/// free and unknown cells are not told apart. Other keys are ignored, as map_server does.
struct OccupancyMap {
  std::size_t columns = 0;
  std::size_t rows = 0;
  double resolution_m = 0.05;
  Pose2 origin;
  std::string image_file = {};      ///< path, resolved from the YAML file's folder
  std::vector<bool> occupied = {};  ///< row after row, the one at the origin first

  bool at(std::size_t column, std::size_t row) const { return occupied[row * columns + column]; }
};

/// Throws UsageError of one line that names the file, the key and what is allowed.
OccupancyMap load_occupancy_map(const std::string& yaml_file);

/// The occupied cells as few rectangles: together they cover these cells and nothing else, none
/// twice.
std::vector<Shape> occupied_shapes(const OccupancyMap& map);

/// The largest resolution with which all occupied cells, `shapes`, would be within ±half_extent_m
/// in x and y, the origin being where it is; 0 if none is small enough.
double largest_resolution_m(const OccupancyMap& map, const std::vector<Shape>& shapes,
                            double half_extent_m);

}  // namespace tether
