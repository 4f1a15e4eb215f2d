#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/ros2/ros2_messages.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/messages/message_printer.hpp"

namespace tether {

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
