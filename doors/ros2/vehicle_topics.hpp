#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/time.hpp"
#include "common/ros2/ros2_messages.hpp"
#include "common/vehicle/pose.hpp"
#include "common/world/scan.hpp"

namespace tether {

/// Prefix of a vehicle's topics and frames: "agv7" of AGV7. "" for the only vehicle of a run, whose
/// topics are /odom, /cmd_vel and so on. Characters that ROS 2 does not allow in names become '_'.
std::string ros2_namespace(const std::string& vehicle, bool is_alone);

/// Topics of one vehicle: /pose, /odom, /scan, /tf (map → odom → base_link) and /tf_static
/// (base_link → laser), all in the vehicle's namespace. Pure.
///
/// The newest pose and the odometry of the nearest stamp give map → odom. Without odometry, odom is
/// map and the pose gives odom → base_link.
class VehicleTopics {
 public:
  struct Odometry {
    Instant stamp;
    Pose2 pose;
    PlanarCovariance covariance{};
    Twist twist;
  };

  /// `shift_ns` is added to all stamps.
  VehicleTopics(const std::string& name_space, std::int64_t shift_ns);

  std::string topic(const std::string& name) const { return prefix_ + name; }
  const std::string& base_frame() const { return base_; }

  /// Messages for a usable pose, odometry or scan.
  std::vector<RosMessage> on_pose(Instant stamp, const Pose2& pose);
  std::vector<RosMessage> on_odometry(const Odometry& odometry);
  std::vector<RosMessage> on_scan(const Scan& scan);

 private:
  std::int64_t ns(Instant t) const { return (t - kStart).count() + shift_ns_; }
  RosMessage tf(std::vector<RosTransform> transforms) const;

  std::string prefix_;  ///< "/" or "/agv7/"
  std::string odom_, base_, laser_;
  std::int64_t shift_ns_;
  Pose2 map_to_odom_;
  std::deque<std::pair<Instant, Pose2>> odometry_;  ///< newest last
  std::optional<Pose2> mount_;
};

}  // namespace tether
