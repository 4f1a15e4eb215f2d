#pragma once

#include <string>
#include <string_view>

namespace tether {

inline constexpr std::string_view kRosClock = "rosgraph_msgs/msg/Clock";
inline constexpr std::string_view kRosTwist = "geometry_msgs/msg/Twist";
inline constexpr std::string_view kRosPoseStamped = "geometry_msgs/msg/PoseStamped";
inline constexpr std::string_view kRosOdometry = "nav_msgs/msg/Odometry";
inline constexpr std::string_view kRosPath = "nav_msgs/msg/Path";
inline constexpr std::string_view kRosLaserScan = "sensor_msgs/msg/LaserScan";
inline constexpr std::string_view kRosTf = "tf2_msgs/msg/TFMessage";

/// The definition of one of the types above for MCAP's schema encoding "ros2msg": its fields, then
/// those of each type that it needs, behind a line of 80 '=' and "MSG: package/Type"
/// (mcap.dev/spec/registry). Fields as in ROS 2's common_interfaces and geometry2, without
/// comments.
std::string ros2_schema(std::string_view type);

}  // namespace tether
