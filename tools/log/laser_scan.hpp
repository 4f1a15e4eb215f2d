#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/ros2/laser_scan.hpp"
#include "tools/messages/message_printer.hpp"

namespace tether {

/// Converts a scan_t; nothing if it is not one, or not all of its numbers are finite.
std::optional<LaserScan> laser_scan_of(const MessageContent& message);

/// A foxglove.LaserScan of a vehicle whose axle's midpoint is `frame`. Beams of which nothing came
/// back are 0, where the scanner is.
std::string laser_scan_json(const LaserScan& scan, std::string_view frame, std::int64_t time_ns);

}  // namespace tether
