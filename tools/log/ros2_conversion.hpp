#pragma once

#include <bit>
#include <concepts>
#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "tools/log/scene_setting.hpp"
#include "tools/messages/message_printer.hpp"

namespace tether {

/// Encodes as ROS 2 does on the wire and in bags: OMG's Common Data Representation, XCDR version 1,
/// little-endian. The first four bytes say so (encapsulation 0x0001, options 0). Behind them each
/// number lies at a multiple of its own size, a text is its length with the final NUL, then both,
/// and a sequence is its number of elements, then they; arrays of fixed size have no number.
/// (DDS-XTypes 1.3, section 7.4.1; npm's @foxglove/rosmsg2-serialization reads it, in a test.)
class CdrWriter {
 public:
  std::string bytes = std::string("\x00\x01\x00\x00", kHeader);

  void put(std::int32_t x) { little_endian(static_cast<std::uint32_t>(x)); }
  void put(std::uint32_t x) { little_endian(x); }
  void put(float x) { little_endian(std::bit_cast<std::uint32_t>(x)); }
  void put(double x) { little_endian(std::bit_cast<std::uint64_t>(x)); }
  void put(std::string_view text) {
    little_endian(static_cast<std::uint32_t>(text.size() + 1));
    bytes += text;
    bytes += '\0';
  }
  /// Begins a sequence; its elements follow.
  void sequence(std::size_t count) { little_endian(static_cast<std::uint32_t>(count)); }

 private:
  static constexpr std::size_t kHeader = 4;

  template <std::unsigned_integral T>
  void little_endian(T x) {
    while ((bytes.size() - kHeader) % sizeof(T) != 0) bytes += '\0';
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes += static_cast<char>(x >> (8 * i));
  }
};

/// One message of ROS 2.
struct RosMessage {
  std::string topic;
  std::string_view type;  ///< "geometry_msgs/msg/Twist"
  std::string cdr;
};

/// Conversion of Tether's messages to ROS 2:
///
/// | channel                   | topic             | type                            |
/// |---------------------------|-------------------|---------------------------------|
/// | SIM/CLOCK                 | /clock            | rosgraph_msgs/msg/Clock         |
/// | SIM/TRUTH                 | /ground_truth     | nav_msgs/msg/Odometry, in "map" |
/// | …/CMD_VEL (twist_t)       | /cmd_vel …        | geometry_msgs/msg/Twist         |
/// | …/POSE (pose_t)           | /agv/pose …       | geometry_msgs/msg/PoseStamped   |
/// | …/ODOMETRY (odometry_t)   | /odom …           | nav_msgs/msg/Odometry, in "odom"|
/// | …/SCAN (scan_t)           | /scan …           | sensor_msgs/msg/LaserScan       |
///
/// Topics are the channels' names in lower case ("/ctrl/cmd_vel"); with three exceptions.
/// AGV/CMD_VEL, the command that reaches the vehicle, is /cmd_vel. AGV/SCAN is /scan, in "laser",
/// which each scan places in "base_link" by /tf. The odometry nearest to the wheels (CAN/ODOMETRY,
/// else AGV/ODOMETRY) is /odom. /tf (tf2_msgs/msg/TFMessage) has "base_link" in "map", from the
/// best source that the log has: SIM/TRUTH, else that odometry (in "odom"), else AGV/POSE, else
/// CTRL/POSE. "odom" is where "map" is: dead reckoning begins at the start pose, and drifts. /plan
/// (nav_msgs/msg/Path) is the scenario's path. Stamps are the messages' utime, which is the time of
/// /clock. Other types have no counterpart in ROS 2's common interfaces.
class RosConversion {
 public:
  /// `channels`: all of the log. `shift_ns` is added to all stamps.
  RosConversion(const std::set<std::string>& channels, std::int64_t shift_ns);

  /// Appends what the message is in ROS 2; false if nothing.
  bool convert(std::string_view channel, const MessageContent& message,
               std::vector<RosMessage>& out) const;

  /// /plan. The stamp of each pose is when the vehicle should be there.
  RosMessage plan(const std::vector<TimedPoint>& path) const;

 private:
  std::string topic_of(std::string_view channel) const;
  void add_tf(std::string_view channel, std::int64_t stamp_ns, const Pose2& pose, bool in_odom,
              std::vector<RosMessage>& out) const;

  std::int64_t shift_ns_;
  std::string odometry_;   // the channel that is /odom
  std::string tf_source_;  // the channel that /tf is made of
};

}  // namespace tether
