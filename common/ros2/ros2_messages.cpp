#include "common/ros2/ros2_messages.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <sstream>
#include <vector>

#include "common/ros2/cdr.hpp"

namespace tether {
namespace {

struct Definition {
  std::string_view type;  // "package/Type"
  std::string_view fields;
};

constexpr Definition kDefinitions[] = {
    {"builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"},
    {"std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"},
    {"rosgraph_msgs/Clock", "builtin_interfaces/Time clock\n"},
    {"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"},
    {"geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"},
    {"geometry_msgs/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose\n"},
    {"geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance\n"},
    {"geometry_msgs/Twist", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"},
    {"geometry_msgs/TwistWithCovariance", "geometry_msgs/Twist twist\nfloat64[36] covariance\n"},
    {"geometry_msgs/Transform",
     "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"},
    {"geometry_msgs/TransformStamped",
     "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"},
    {"nav_msgs/Odometry",
     "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
     "geometry_msgs/TwistWithCovariance twist\n"},
    {"nav_msgs/Path", "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n"},
    {"sensor_msgs/LaserScan",
     "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n"
     "float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\n"
     "float32[] ranges\nfloat32[] intensities\n"},
    {"tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"},
};

const Definition* find(std::string_view type) {
  const auto* const found = std::ranges::find(kDefinitions, type, &Definition::type);
  return found == std::end(kDefinitions) ? nullptr : found;
}

/// All that a type's fields need, each once, after the types that are already there.
void add_needed(const Definition& definition, std::vector<const Definition*>& all) {
  std::istringstream lines{std::string(definition.fields)};
  for (std::string line; std::getline(lines, line);) {
    const Definition* const needed = find(line.substr(0, line.find_first_of(" [")));
    if (needed == nullptr || std::ranges::find(all, needed) != all.end()) continue;
    all.push_back(needed);
    add_needed(*needed, all);
  }
}

}  // namespace

std::string ros2_schema(std::string_view type) {
  constexpr std::string_view kMsg = "/msg/";
  const std::size_t at = type.find(kMsg);
  assert(at != std::string_view::npos);
  const Definition* const definition =
      find(fmt::format("{}/{}", type.substr(0, at), type.substr(at + kMsg.size())));
  assert(definition != nullptr);
  std::vector<const Definition*> all;
  add_needed(*definition, all);
  std::string text(definition->fields);
  for (const Definition* needed : all) {
    text.append(80, '=');
    text += "\nMSG: ";
    text += needed->type;
    text += '\n';
    text += needed->fields;
  }
  return text;
}

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
