#include "tools/ros2/ros2_schemas.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <sstream>
#include <vector>

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

}  // namespace tether
