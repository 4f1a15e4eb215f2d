#include "tools/log/ros2_conversion.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <initializer_list>

#include "common/vehicle/pose.hpp"
#include "tools/log/scene_view.hpp"

namespace tether {
namespace {

constexpr std::string_view kMap = "map", kOdom = "odom", kBase = "base_link", kLaser = "laser";

/// The first of these that the log has; empty if it has none.
std::string first_of(const std::set<std::string>& channels,
                     std::initializer_list<const char*> wanted) {
  for (const char* channel : wanted) {
    if (channels.contains(channel)) return channel;
  }
  return "";
}

/// Microseconds to nanoseconds; what would overflow stays where a 64-bit number can be shifted.
std::int64_t nanoseconds(std::int64_t us) {
  constexpr std::int64_t kMost_us = INT64_MAX / 2000;
  return std::clamp(us, -kMost_us, kMost_us) * 1000;
}

Twist twist_of(const MessageContent& message) {
  return {message.real("v_mps").value_or(0.0), message.real("omega_radps").value_or(0.0)};
}

PlanarCovariance covariance_of(const MessageContent& message) {
  PlanarCovariance covariance{};
  constexpr std::array kNames = {"cov_x_x_m2", "cov_x_y_m2",      "cov_x_yaw_m_rad",
                                 "cov_y_y_m2", "cov_y_yaw_m_rad", "cov_yaw_yaw_rad2"};
  for (std::size_t i = 0; i < covariance.size(); ++i) {
    covariance[i] = message.real(kNames[i]).value_or(0.0);
  }
  return covariance;
}

}  // namespace

RosConversion::RosConversion(const std::set<std::string>& channels, std::int64_t shift_ns)
    : shift_ns_(shift_ns),
      odometry_(first_of(channels, {"CAN/ODOMETRY", "AGV/ODOMETRY"})),
      tf_source_(first_of(
          channels, {"SIM/TRUTH", "CAN/ODOMETRY", "AGV/ODOMETRY", "AGV/POSE", "CTRL/POSE"})) {}

std::string RosConversion::topic_of(std::string_view channel) const {
  if (channel == odometry_) return "/odom";
  if (channel == "AGV/CMD_VEL") return "/cmd_vel";
  if (channel == "AGV/SCAN") return "/scan";
  if (channel == "SIM/TRUTH") return "/ground_truth";
  if (channel == "SIM/CLOCK") return "/clock";
  // Names between slashes are not empty and begin with no digit.
  std::string topic;
  for (const char c : channel) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '/') {
      if (!topic.ends_with('/')) topic += '/';
      continue;
    }
    if (topic.empty()) topic += '/';
    if (topic.ends_with('/') && std::isdigit(byte) != 0) topic += '_';
    topic += std::isalnum(byte) != 0 ? static_cast<char>(std::tolower(byte)) : '_';
  }
  if (topic.ends_with('/')) topic += '_';
  return topic;
}

void RosConversion::add_tf(std::string_view channel, std::int64_t stamp_ns, const Pose2& pose,
                           bool in_odom, std::vector<RosMessage>& out) const {
  if (channel != tf_source_) return;
  std::vector<RosTransform> transforms = {{{stamp_ns, kMap}, kOdom, {}},
                                          {{stamp_ns, in_odom ? kOdom : kMap}, kBase, pose}};
  out.push_back({"/tf", kRosTf, tf_cdr(transforms)});
}

bool RosConversion::convert(std::string_view channel, const MessageContent& message,
                            std::vector<RosMessage>& out) const {
  if (!message.decoded()) return false;
  const std::string& type = message.type->name;
  const std::int64_t stamp_ns = nanoseconds(message.integer("utime").value_or(0)) + shift_ns_;
  if (type == "clock_t") {
    out.push_back({topic_of(channel), kRosClock, clock_cdr(stamp_ns)});
    return true;
  }
  if (type == "twist_t") {
    out.push_back({topic_of(channel), kRosTwist, twist_cdr(twist_of(message))});
    return true;
  }
  if (const auto scan = laser_scan_of(message)) {
    const RosTransform mount{{stamp_ns, kBase}, kLaser, scan->mount};
    out.push_back({topic_of(channel), kRosLaserScan, laser_scan_cdr({stamp_ns, kLaser}, *scan)});
    if (channel == "AGV/SCAN") out.push_back({"/tf", kRosTf, tf_cdr({mount})});
    return true;
  }
  if (type != "pose_t" && type != "odometry_t" && type != "ground_truth_t") return false;
  const Pose2 pose{message.real("x_m").value_or(0.0), message.real("y_m").value_or(0.0),
                   message.real("yaw_rad").value_or(0.0)};
  const bool in_odom = type == "odometry_t";
  const RosHeader header{stamp_ns, in_odom ? kOdom : kMap};
  if (type == "pose_t") {
    out.push_back({topic_of(channel), kRosPoseStamped, pose_cdr({header, pose})});
  } else {
    out.push_back({topic_of(channel), kRosOdometry,
                   odometry_cdr({header, kBase, pose}, covariance_of(message), twist_of(message))});
  }
  if (is_usable(pose)) add_tf(channel, stamp_ns, pose, in_odom, out);
  return true;
}

RosMessage RosConversion::plan(const std::vector<TimedPoint>& path) const {
  std::vector<RosPose> poses;
  for (const TimedPoint& p : path) {
    const auto stamp_ns = std::llround(p.t_s * 1e9) + shift_ns_;
    poses.push_back({{stamp_ns, kMap}, {p.point.x_m, p.point.y_m, p.point.yaw_rad}});
  }
  return {"/plan", kRosPath, path_cdr({shift_ns_, kMap}, poses)};
}

}  // namespace tether
