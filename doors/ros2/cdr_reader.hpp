#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/vehicle/pose.hpp"

namespace tether {

/// A geometry_msgs/msg/Twist, or TwistStamped, as it came. Its numbers may be anything.
struct RosCommand {
  /// Time and frame of a TwistStamped.
  struct Header {
    std::int64_t stamp_ns = 0;
    std::string frame_id;
  };
  std::optional<Header> header;
  Twist twist;
  double other = 0.0;  ///< sum of the magnitudes of linear y, z and angular x, y
};

/// Decodes a message in XCDR version 1, little- or big-endian; nullopt if its length, its
/// encapsulation or the length of its text is impossible. Never reads beyond `cdr`.
std::optional<RosCommand> read_twist(std::string_view cdr);
std::optional<RosCommand> read_twist_stamped(std::string_view cdr);

}  // namespace tether
