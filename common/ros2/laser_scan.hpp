#pragma once

#include <vector>

#include "common/vehicle/pose.hpp"

namespace tether {

/// Parts of a scan_t that viewers need.
struct LaserScan {
  Pose2 mount;  ///< pose of the scanner, relative to the vehicle's axle's midpoint
  double angle_min_rad = 0.0, angle_increment_rad = 0.0, time_increment_s = 0.0;
  double range_min_m = 0.0, range_max_m = 0.0;
  std::vector<float> range_m;  ///< 0: nothing came back

  double angle_max_rad() const {
    const double last = range_m.empty() ? 0.0 : static_cast<double>(range_m.size() - 1);
    return angle_min_rad + angle_increment_rad * last;
  }
};

}  // namespace tether
