#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/ros2/laser_scan.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

inline constexpr std::string_view kRosClock = "rosgraph_msgs/msg/Clock";
inline constexpr std::string_view kRosTwist = "geometry_msgs/msg/Twist";
inline constexpr std::string_view kRosTwistStamped = "geometry_msgs/msg/TwistStamped";
inline constexpr std::string_view kRosPoseStamped = "geometry_msgs/msg/PoseStamped";
inline constexpr std::string_view kRosOdometry = "nav_msgs/msg/Odometry";
inline constexpr std::string_view kRosPath = "nav_msgs/msg/Path";
inline constexpr std::string_view kRosLaserScan = "sensor_msgs/msg/LaserScan";
inline constexpr std::string_view kRosTf = "tf2_msgs/msg/TFMessage";

/// One message of ROS 2.
struct RosMessage {
  std::string topic;
  std::string_view type;  ///< "geometry_msgs/msg/Twist"
  std::string cdr;
};

/// The definition of one of the types above for MCAP's schema encoding "ros2msg": its fields, then
/// those of each type that it needs, behind a line of 80 '=' and "MSG: package/Type"
/// (mcap.dev/spec/registry). Fields as in ROS 2's common_interfaces and geometry2, without
/// comments.
std::string ros2_schema(std::string_view type);

// Messages of ROS 2 in CDR. Everything is planar: z, roll and pitch are 0. Times are nanoseconds of
// the run; ROS 2 has whole seconds in 32 bits, at whose ends they stop.

/// std_msgs/Header
struct RosHeader {
  std::int64_t stamp_ns = 0;
  std::string_view frame_id;
};

/// Covariance of a pose in the plane: x², xy, x·yaw, y², y·yaw, yaw².
using PlanarCovariance = std::array<double, 6>;

struct RosTransform {
  RosHeader header;
  std::string_view child_frame_id;
  Pose2 pose;
};

struct RosPose {
  RosHeader header;
  Pose2 pose;
};

std::string clock_cdr(std::int64_t time_ns);
std::string twist_cdr(const Twist& twist);
std::string pose_cdr(const RosPose& pose);
/// The twist's covariance is zeros, as ROS 2 has it for what is not known.
std::string odometry_cdr(const RosTransform& pose, const PlanarCovariance& covariance,
                         const Twist& twist);
/// Beams of which nothing came back are +inf, as REP 117 has it; the time between two scans is 0,
/// not known.
std::string laser_scan_cdr(const RosHeader& header, const LaserScan& scan);
std::string path_cdr(const RosHeader& header, const std::vector<RosPose>& poses);
std::string tf_cdr(const std::vector<RosTransform>& transforms);

}  // namespace tether
