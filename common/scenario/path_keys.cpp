#include "common/scenario/path_keys.hpp"

#include <map>
#include <set>
#include <utility>

namespace tether {
namespace {

using Kind = Scenario::Path::Kind;

constexpr Range kSize{0.1, 1e4, false};
constexpr Range kStart_m{-1e4, 1e4, false};
constexpr Range kAngle{-100.0, 100.0, false};
constexpr Range kLimit{0.01, 50.0, false};

const Names<Kind>& kinds() {
  static const Names<Kind> names{{"figure_eight", Kind::figure_eight},
                                 {"circle", Kind::circle},
                                 {"line", Kind::line},
                                 {"rounded_rectangle", Kind::rounded_rectangle},
                                 {"csv", Kind::csv}};
  return names;
}

/// The kinds for which each key has an effect; path.kind has one for all.
const std::map<std::string, std::set<Kind>>& users() {
  constexpr Kind kEight = Kind::figure_eight, kCircle = Kind::circle, kLine = Kind::line,
                 kRectangle = Kind::rounded_rectangle, kCsv = Kind::csv;
  static const std::map<std::string, std::set<Kind>> users{
      {"path.amplitude_m", {kEight}},
      {"path.rate_radps", {kEight}},
      {"path.rotation_rad", {kEight}},
      {"path.csv", {kCsv}},
      {"path.radius_m", {kCircle}},
      {"path.length_m", {kLine, kRectangle}},
      {"path.width_m", {kRectangle}},
      {"path.corner_radius_m", {kRectangle}},
      {"path.clockwise", {kCircle, kRectangle}},
      {"path.start_x_m", {kCircle, kLine, kRectangle}},
      {"path.start_y_m", {kCircle, kLine, kRectangle}},
      {"path.start_yaw_rad", {kCircle, kLine, kRectangle}},
      {"path.speed_mps", {kCircle, kLine, kRectangle, kCsv}},
      {"path.max_acceleration_mps2", {kCircle, kLine, kRectangle, kCsv}},
      {"path.max_deceleration_mps2", {kLine, kRectangle, kCsv}},
      {"path.max_lateral_acceleration_mps2", {kCircle, kRectangle, kCsv}},
      {"path.max_yaw_rate_radps", {kCircle, kRectangle, kCsv}},
      {"path.max_yaw_acceleration_radps2", {kCircle, kRectangle, kCsv}}};
  return users;
}

void add_limits(KeyTable& t) {
  t.number("path.speed_mps", TETHER_FIELD(path.limits.speed_mps), kLimit,
           "cruise; less where another limit says so");
  t.number("path.max_acceleration_mps2", TETHER_FIELD(path.limits.max_acceleration_mps2), kLimit,
           "along the path; it begins at rest");
  t.number("path.max_deceleration_mps2", TETHER_FIELD(path.limits.max_deceleration_mps2), kLimit,
           "along the path; open ones end at rest");
  t.number("path.max_lateral_acceleration_mps2",
           TETHER_FIELD(path.limits.max_lateral_acceleration_mps2), kLimit,
           "square of the speed times curvature");
  t.number("path.max_yaw_rate_radps", TETHER_FIELD(path.limits.max_yaw_rate_radps), kLimit,
           "speed times curvature");
  t.number("path.max_yaw_acceleration_radps2",
           TETHER_FIELD(path.limits.max_yaw_acceleration_radps2), kLimit,
           "half of it for changes of the curvature, half for those of the speed");
}

}  // namespace

void add_path_keys(KeyTable& t) {
  t.choice<Kind>("path.kind", TETHER_FIELD(path.kind), kinds(), "reference path");
  t.number("path.amplitude_m", TETHER_FIELD(path.figure_eight.amplitude_m), {1e-3, 1e4, false},
           "half length of the figure eight");
  t.number("path.rate_radps", TETHER_FIELD(path.figure_eight.rate_radps), {1e-6, 100.0, false},
           "one eight takes 2*pi/this seconds");
  t.number("path.rotation_rad", TETHER_FIELD(path.figure_eight.rotation_rad), kAngle,
           "of the eight's long axis against +x");
  t.text("path.csv", TETHER_FIELD(path.csv),
         "waypoints, CSV: x_m, y_m and, if wanted, v_mps; relative to the scenario file");
  t.number("path.radius_m", TETHER_FIELD(path.radius_m), kSize, "of the circle");
  t.number("path.length_m", TETHER_FIELD(path.length_m), kSize,
           "of the line; of the rectangle, along the start's heading");
  t.number("path.width_m", TETHER_FIELD(path.width_m), kSize,
           "of the rectangle, across the start's heading");
  t.number("path.corner_radius_m", TETHER_FIELD(path.corner_radius_m), kSize,
           "least radius in the rectangle's corners, which are clothoids");
  t.boolean("path.clockwise", TETHER_FIELD(path.clockwise),
            "circle and rectangle turn right instead of left");
  t.number("path.start_x_m", TETHER_FIELD(path.start.x_m), kStart_m,
           "start of circle, line and rectangle");
  t.number("path.start_y_m", TETHER_FIELD(path.start.y_m), kStart_m,
           "start of circle, line and rectangle");
  t.number("path.start_yaw_rad", TETHER_FIELD(path.start.yaw_rad), kAngle,
           "heading at the start of circle, line and rectangle");
  add_limits(t);
}

std::string why_path_ignores(const Scenario& scenario, const std::string& key) {
  const auto found = users().find(key);
  if (found == users().end() || found->second.contains(scenario.path.kind)) return "";
  for (const auto& [name, kind] : kinds()) {
    if (kind == scenario.path.kind) return "path.kind is \"" + name + "\"";
  }
  return "";
}

}  // namespace tether
