#include "tools/ros2/ros2_messages.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/ros2/cdr_writer.hpp"

namespace tether {
namespace {

void put_time(CdrWriter& out, std::int64_t time_ns) {
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  const std::int64_t rest_ns = (time_ns % kSecond_ns + kSecond_ns) % kSecond_ns;
  const std::int64_t seconds = (time_ns - rest_ns) / kSecond_ns;
  using Limits = std::numeric_limits<std::int32_t>;
  out.put(
      static_cast<std::int32_t>(std::clamp<std::int64_t>(seconds, Limits::min(), Limits::max())));
  out.put(static_cast<std::uint32_t>(rest_ns));
}

void put_header(CdrWriter& out, const RosHeader& header) {
  put_time(out, header.stamp_ns);
  out.put(header.frame_id);
}

void put_vector(CdrWriter& out, double x, double y, double z) {
  out.put(x);
  out.put(y);
  out.put(z);
}

/// Position and orientation, as geometry_msgs/Pose and geometry_msgs/Transform have them.
void put_pose(CdrWriter& out, const Pose2& pose) {
  put_vector(out, pose.x_m, pose.y_m, 0.0);
  put_vector(out, 0.0, 0.0, std::sin(pose.yaw_rad / 2.0));
  out.put(std::cos(pose.yaw_rad / 2.0));
}

void put_twist(CdrWriter& out, const Twist& twist) {
  put_vector(out, twist.v_mps, 0.0, 0.0);
  put_vector(out, 0.0, 0.0, twist.omega_radps);
}

/// 6 × 6, row by row, of x, y, z and the rotations about x, y, z.
void put_covariance(CdrWriter& out, const PlanarCovariance& c) {
  std::array<double, 36> all{};
  constexpr std::size_t kX = 0, kY = 1, kYaw = 5;
  const auto set = [&](std::size_t row, std::size_t column, double value) {
    all[6 * row + column] = value;
    all[6 * column + row] = value;
  };
  set(kX, kX, c[0]);
  set(kX, kY, c[1]);
  set(kX, kYaw, c[2]);
  set(kY, kY, c[3]);
  set(kY, kYaw, c[4]);
  set(kYaw, kYaw, c[5]);
  for (const double value : all) out.put(value);
}

}  // namespace

std::string clock_cdr(std::int64_t time_ns) {
  CdrWriter out;
  put_time(out, time_ns);
  return out.bytes;
}

std::string twist_cdr(const Twist& twist) {
  CdrWriter out;
  put_twist(out, twist);
  return out.bytes;
}

std::string pose_cdr(const RosPose& pose) {
  CdrWriter out;
  put_header(out, pose.header);
  put_pose(out, pose.pose);
  return out.bytes;
}

std::string odometry_cdr(const RosTransform& pose, const PlanarCovariance& covariance,
                         const Twist& twist) {
  CdrWriter out;
  put_header(out, pose.header);
  out.put(pose.child_frame_id);
  put_pose(out, pose.pose);
  put_covariance(out, covariance);
  put_twist(out, twist);
  put_covariance(out, {});
  return out.bytes;
}

std::string laser_scan_cdr(const RosHeader& header, const LaserScan& scan) {
  CdrWriter out;
  put_header(out, header);
  for (const double value : {scan.angle_min_rad, scan.angle_max_rad(), scan.angle_increment_rad,
                             scan.time_increment_s, 0.0, scan.range_min_m, scan.range_max_m}) {
    out.put(static_cast<float>(value));
  }
  out.sequence(scan.range_m.size());
  for (const float range_m : scan.range_m) {
    out.put(range_m > 0.0F ? range_m : std::numeric_limits<float>::infinity());
  }
  out.sequence(0);  // intensities
  return out.bytes;
}

std::string path_cdr(const RosHeader& header, const std::vector<RosPose>& poses) {
  CdrWriter out;
  put_header(out, header);
  out.sequence(poses.size());
  for (const RosPose& pose : poses) {
    put_header(out, pose.header);
    put_pose(out, pose.pose);
  }
  return out.bytes;
}

std::string tf_cdr(const std::vector<RosTransform>& transforms) {
  CdrWriter out;
  out.sequence(transforms.size());
  for (const RosTransform& transform : transforms) {
    put_header(out, transform.header);
    out.put(transform.child_frame_id);
    put_pose(out, transform.pose);
  }
  return out.bytes;
}

}  // namespace tether
