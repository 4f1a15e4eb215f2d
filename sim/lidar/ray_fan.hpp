#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/path/reference_path.hpp"

namespace tether {

/// Rays that leave nearly one point one after another, each somewhat to the left of the one before,
/// by nearly equal angles: those of a scanner that moves meanwhile. Reusing one allocates nothing.
class RayFan {
 public:
  static constexpr double kNothing = std::numeric_limits<double>::infinity();
  static constexpr std::int64_t kNoShape = -1;

  void clear();
  /// `angle_rad`: of its direction, world frame, not wrapped. `time_s`: after the instant for which
  /// moving shapes are given.
  void add(const Position& from, double angle_rad, double time_s);

  std::size_t size() const { return x_m.size(); }

  // By ray.
  std::vector<double> x_m, y_m;  ///< where it begins
  std::vector<double> dx, dy;    ///< unit vector along it
  std::vector<double> angle_rad;
  std::vector<double> time_s;
  // Results of RayCaster.
  std::vector<double> range_m;      ///< range of the first surface; kNothing: none
  std::vector<std::int64_t> shape;  ///< which that is of, for RayCaster::hit(), or kNoShape

  std::vector<double> seen_x_m, seen_y_m;  ///< where it begins, as who moves sees it
};

inline void RayFan::clear() {
  for (auto* values : {&x_m, &y_m, &dx, &dy, &angle_rad, &time_s, &range_m, &seen_x_m, &seen_y_m}) {
    values->clear();
  }
  shape.clear();
}

inline void RayFan::add(const Position& from, double angle, double time) {
  x_m.push_back(from.x_m);
  y_m.push_back(from.y_m);
  dx.push_back(std::cos(angle));
  dy.push_back(std::sin(angle));
  angle_rad.push_back(angle);
  time_s.push_back(time);
  range_m.push_back(kNothing);
  shape.push_back(kNoShape);
  seen_x_m.push_back(0.0);
  seen_y_m.push_back(0.0);
}

}  // namespace tether
