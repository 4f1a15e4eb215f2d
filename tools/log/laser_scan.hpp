#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/vehicle/pose.hpp"
#include "tools/messages/message_printer.hpp"

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

/// Converts a scan_t; nothing if it is not one, or not all of its numbers are finite.
std::optional<LaserScan> laser_scan_of(const MessageContent& message);

/// A foxglove.LaserScan of a vehicle whose axle's midpoint is `frame`. Beams of which nothing came
/// back are 0, where the scanner is.
std::string laser_scan_json(const LaserScan& scan, std::string_view frame, std::int64_t time_ns);

}  // namespace tether
