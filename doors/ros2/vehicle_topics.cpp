#include "doors/ros2/vehicle_topics.hpp"

#include <algorithm>
#include <cctype>

#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

constexpr std::string_view kMap = "map";
constexpr std::size_t kOdometryKept = 512;

}  // namespace

std::string ros2_namespace(const std::string& vehicle, bool is_alone) {
  if (is_alone) return "";
  std::string name;
  for (const char c : vehicle) {
    const auto byte = static_cast<unsigned char>(c);
    if (name.empty() && std::isdigit(byte) != 0) name += '_';
    name += std::isalnum(byte) != 0 ? static_cast<char>(std::tolower(byte)) : '_';
  }
  return name;
}

VehicleTopics::VehicleTopics(const std::string& name_space, std::int64_t shift_ns)
    : prefix_(name_space.empty() ? "/" : "/" + name_space + "/"), shift_ns_(shift_ns) {
  const std::string frames = name_space.empty() ? "" : name_space + "/";
  odom_ = frames + "odom";
  base_ = frames + "base_link";
  laser_ = frames + "laser";
}

RosMessage VehicleTopics::tf(std::vector<RosTransform> transforms) const {
  return {topic("tf"), kRosTf, tf_cdr(transforms)};
}

std::vector<RosMessage> VehicleTopics::on_pose(Instant stamp, const Pose2& pose) {
  const RosHeader in_map{ns(stamp), kMap};
  std::vector<RosTransform> transforms;
  if (odometry_.empty()) {
    transforms = {{in_map, odom_, {}}, {{ns(stamp), odom_}, base_, pose}};
  } else {
    const auto nearest =
        std::min_element(odometry_.begin(), odometry_.end(), [&](const auto& a, const auto& b) {
          return std::chrono::abs(a.first - stamp) < std::chrono::abs(b.first - stamp);
        });
    map_to_odom_ = compose(pose, relative_to(nearest->second, {}));
    transforms = {{in_map, odom_, map_to_odom_}};
  }
  return {{topic("pose"), kRosPoseStamped, pose_cdr({in_map, pose})}, tf(transforms)};
}

std::vector<RosMessage> VehicleTopics::on_odometry(const Odometry& odometry) {
  odometry_.emplace_back(odometry.stamp, odometry.pose);
  if (odometry_.size() > kOdometryKept) odometry_.pop_front();
  const RosTransform pose{{ns(odometry.stamp), odom_}, base_, odometry.pose};
  return {{topic("odom"), kRosOdometry, odometry_cdr(pose, odometry.covariance, odometry.twist)},
          tf({pose})};
}

std::vector<RosMessage> VehicleTopics::on_scan(const Scan& scan) {
  LaserScan out;
  out.mount = scan.mount;
  out.angle_min_rad = scan.angle_min_rad;
  out.angle_increment_rad = scan.angle_increment_rad;
  out.time_increment_s = scan.time_increment_s;
  out.range_min_m = scan.range_min_m;
  out.range_max_m = scan.range_max_m;
  out.range_m = scan.range_m;
  std::vector<RosMessage> all;
  if (mount_ != scan.mount) {
    mount_ = scan.mount;
    all.push_back(
        {topic("tf_static"), kRosTf, tf_cdr({{{ns(scan.stamp), base_}, laser_, scan.mount}})});
  }
  all.push_back({topic("scan"), kRosLaserScan, laser_scan_cdr({ns(scan.stamp), laser_}, out)});
  return all;
}

}  // namespace tether
