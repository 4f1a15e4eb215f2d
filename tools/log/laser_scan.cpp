#include "tools/log/laser_scan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "tools/log/scene_view.hpp"
#include "tools/messages/message_json.hpp"

namespace tether {

std::optional<LaserScan> laser_scan_of(const MessageContent& message) {
  if (!message.decoded() || message.type->name != "scan_t") return std::nullopt;
  const auto real = [&message](const char* field) { return message.real(field).value_or(NAN); };
  LaserScan scan{.mount = {real("mount_x_m"), real("mount_y_m"), real("mount_yaw_rad")},
                 .angle_min_rad = real("angle_min_rad"),
                 .angle_increment_rad = real("angle_increment_rad"),
                 .time_increment_s = real("time_increment_s"),
                 .range_min_m = real("range_min_m"),
                 .range_max_m = real("range_max_m"),
                 .range_m = {}};
  const auto& names = message.type->field_names;
  const auto at = std::find(names.begin(), names.end(), "range_m") - names.begin();
  scan.range_m = std::get<std::vector<float>>(message.values.at(static_cast<std::size_t>(at)));
  const auto is_finite = [](auto x) { return std::isfinite(x); };
  const bool is_usable = std::all_of(scan.range_m.begin(), scan.range_m.end(), is_finite) &&
                         is_finite(scan.mount.x_m + scan.mount.y_m + scan.mount.yaw_rad) &&
                         is_finite(scan.angle_max_rad()) && is_finite(scan.time_increment_s) &&
                         is_finite(scan.range_min_m + scan.range_max_m);
  if (!is_usable) return std::nullopt;
  return scan;
}

std::string laser_scan_json(const LaserScan& scan, std::string_view frame, std::int64_t time_ns) {
  std::string json = fmt::format("{{\"timestamp\":{},\"frame_id\":", time_json(time_ns));
  append_json_string(json, frame);
  fmt::format_to(std::back_inserter(json),
                 R"(,"pose":{},"start_angle":{},"end_angle":{},"ranges":[{}],"intensities":[]}})",
                 pose_json(scan.mount), scan.angle_min_rad, scan.angle_max_rad(),
                 fmt::join(scan.range_m, ","));
  return json;
}

}  // namespace tether
