#include "common/path/path_settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/path/controlled_point.hpp"
#include "common/path/kinds.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/grip.hpp"
#include "common/vehicle/motor_torque.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

using Path = PathSettings;

constexpr const char* kPrefix = "path.";
constexpr Range kSize{0.1, 1e4, false};
constexpr Range kStart_m{-1e4, 1e4, false};
constexpr Range kAngle{-100.0, 100.0, false};
constexpr Range kLimit{0.01, 50.0, false};

void add_shapes(KeyTable<Path>& t) {
  t.number("amplitude_m", TETHER_MEMBER(figure_eight.amplitude_m), {1e-3, 1e4, false},
           "half length of the figure eight");
  t.number("rate_radps", TETHER_MEMBER(figure_eight.rate_radps), {1e-6, 100.0, false},
           "angular rate of the figure eight; one eight takes 2*pi/this seconds");
  t.number("rotation_rad", TETHER_MEMBER(figure_eight.rotation_rad), kAngle,
           "angle of the eight's long axis from +x");
  t.file("csv", &Path::csv,
         "waypoints, CSV: x_m, y_m and, if wanted, v_mps; relative to the scenario file");
  t.number("radius_m", &Path::radius_m, kSize, "radius of the circle");
  t.number("length_m", &Path::length_m, kSize,
           "length of the line, or of the rectangle along the start's heading");
  t.number("width_m", &Path::width_m, kSize, "width of the rectangle, across the start's heading");
  t.number("corner_radius_m", &Path::corner_radius_m, kSize,
           "least radius in the rectangle's corners, which are clothoids");
  t.boolean("clockwise", &Path::clockwise, "circle and rectangle turn right instead of left");
  t.number("start_x_m", TETHER_MEMBER(start.x_m), kStart_m, "start of circle, line and rectangle");
  t.number("start_y_m", TETHER_MEMBER(start.y_m), kStart_m, "start of circle, line and rectangle");
  t.number("start_yaw_rad", TETHER_MEMBER(start.yaw_rad), kAngle,
           "heading at the start of circle, line and rectangle");
}

void add_limits(KeyTable<Path>& t) {
  t.number("speed_mps", TETHER_MEMBER(limits.speed_mps), kLimit,
           "cruising speed; lower where another limit applies");
  t.number("max_acceleration_mps2", TETHER_MEMBER(limits.max_acceleration_mps2), kLimit,
           "acceleration limit along the path, which begins at rest");
  t.number("max_deceleration_mps2", TETHER_MEMBER(limits.max_deceleration_mps2), kLimit,
           "deceleration limit along the path; open paths end at rest");
  t.number("max_lateral_acceleration_mps2", TETHER_MEMBER(limits.max_lateral_acceleration_mps2),
           kLimit, "lateral acceleration limit: square of the speed times curvature");
  t.number("max_yaw_rate_radps", TETHER_MEMBER(limits.max_yaw_rate_radps), kLimit,
           "yaw rate limit: speed times curvature");
  t.number(
      "max_yaw_acceleration_radps2", TETHER_MEMBER(limits.max_yaw_acceleration_radps2), kLimit,
      "yaw acceleration limit, half for changes of the curvature and half for those of the speed");
}

std::vector<ScenarioKey> keys() {
  KeyTable<Path> t(kPrefix);
  std::vector<std::string> names;
  for (const PathKind& kind : path_kinds()) names.push_back(kind.name);
  t.one_of("kind", &Path::kind, names, "reference path");
  add_shapes(t);
  add_limits(t);
  t.choice<Path::Point>(
      "point", &Path::point, {{"axle", Path::Point::axle}, {"chassis", Path::Point::chassis}},
      "point of the vehicle that follows the path: the axle's midpoint or the chassis' centre");
  t.number("phase", &Path::phase, kRatio,
           "share of a lap at which a closed path, and its vehicle, begin");
  t.number("offset_x_m", &Path::offset_x_m, kStart_m, "offset of the whole path along x");
  t.number("offset_y_m", &Path::offset_y_m, kStart_m, "offset of the whole path along y");
  for (const PathKind& kind : path_kinds()) t.append(kind.own_keys);
  return t.take();
}

/// A key that only other kinds of path use has no effect.
std::string why_no_effect(const Scenario& scenario, const std::string& key) {
  static const std::set<std::string> of_all{"path.kind", "path.point", "path.phase",
                                            "path.offset_x_m", "path.offset_y_m"};
  if (!key.starts_with(kPrefix) || of_all.contains(key)) return "";
  const PathKind& kind = kind_of(scenario.get<Path>());
  const std::string part = key.substr(std::string_view(kPrefix).size());
  if (std::find(kind.keys.begin(), kind.keys.end(), part) != kind.keys.end()) return "";
  return fmt::format("path.kind is \"{}\"", kind.name);
}

/// Result of `make` for the path; what is wrong with it is said with the scenario's name.
template <class Make>
auto with_name(const Path& settings, const std::string& file, const Make& make) {
  try {
    return make();
  } catch (const UsageError& error) {
    // Errors in a file of waypoints already name the file.
    const bool has_name =
        !settings.csv.empty() && std::string_view(error.what()).starts_with(settings.csv);
    throw UsageError(has_name ? error.what() : fmt::format("{}: {}", file, error.what()));
  }
}

/// Keys of the vehicle's start that are in `given` keep their values.
void start_vehicle(Scenario& scenario, const std::set<std::string>& given,
                   const std::string& file) {
  const auto& path = scenario.get<Path>();
  auto& vehicle = scenario.get<VehicleSettings>();
  const Pose2 start = with_name(path, file, [&] { return start_on(path, vehicle); });
  if (!given.contains("vehicle.start_x_m")) vehicle.start_x_m = start.x_m;
  if (!given.contains("vehicle.start_y_m")) vehicle.start_y_m = start.y_m;
  if (!given.contains("vehicle.start_yaw_rad")) vehicle.start_yaw_rad = start.yaw_rad;
}

void check(const Scenario& scenario, const std::string& file,
           const std::vector<PathLimitsOf>& limits_of) {
  VehicleConfig vehicle = scenario.get<VehicleSettings>();
  if (scenario.get<Path>().point == Path::Point::chassis) {
    if (vehicle.axle_x_m >= 0.0) {
      throw UsageError(
          fmt::format("{}: path.point = \"chassis\" needs an axle behind the chassis' centre: "
                      "vehicle.axle_x_m = {} must be negative",
                      file, vehicle.axle_x_m));
    }
    vehicle.axle_x_m = 0.0;  // it is the box's centre that moves along the path
  }
  const auto path =
      with_name(scenario.get<Path>(), file, [&] { return plan_path(scenario.get<Path>()); });
  if (!path) return;
  std::vector<PathLimit> limits;
  for (const PathLimitsOf& of : limits_of) {
    for (PathLimit& limit : of(scenario)) limits.push_back(std::move(limit));
  }
  check_path(*path, vehicle, scenario.get<WorldSettings>().half_extent_m, limits, file);
}

}  // namespace

Pose2 start_on(const PathSettings& settings, const VehicleSettings& vehicle) {
  const bool is_timed = kind_of(settings).timed != nullptr && !settings.is_moved();
  PathPoint start{.yaw_rad = vehicle.start_yaw_rad};
  if (!is_timed) start = make_path(settings)->at(0.0);
  const Position axle = point_ahead({start.x_m, start.y_m, start.yaw_rad},
                                    -controlled_point_ahead_m(settings, vehicle));
  return {axle.x_m, axle.y_m, start.yaw_rad};
}

ScenarioSection path_section(const std::vector<PathLimitsOf>& limits) {
  ScenarioSection section{.defaults = Path{}, .keys = keys()};
  section.why_no_effect = why_no_effect;
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    const auto& path = scenario.get<Path>();
    return (key.name == "path.phase" && path.phase == 0.0) ||
           (key.name == "path.offset_x_m" && path.offset_x_m == 0.0) ||
           (key.name == "path.offset_y_m" && path.offset_y_m == 0.0);
  };
  section.complete = start_vehicle;
  section.check = [limits](const Scenario& scenario, const std::string& file) {
    check(scenario, file, limits);
  };
  return section;
}

std::vector<PathLimit> vehicle_path_limits(const Scenario& scenario) {
  const auto& vehicle = scenario.get<VehicleSettings>();
  const auto& world = scenario.get<WorldSettings>();
  const bool is_ode = vehicle.plant == VehicleSettings::Plant::ode;
  std::vector<PathLimit> limits{
      {"a wheel's rim speed", "m/s", "vehicle.max_wheel_speed_mps", vehicle.max_wheel_speed_mps,
       [](const PathDemand& d) { return d.rim_speed_mps; }},
      {"a wheel's rim acceleration", "m/s^2", "vehicle.max_wheel_acceleration_mps2",
       vehicle.max_wheel_acceleration_mps2,
       [](const PathDemand& d) { return d.rim_acceleration_mps2; }}};
  if (is_ode) {
    const VehicleConfig& body = vehicle;
    limits.push_back({"a motor's torque", "N*m",
                      vehicle.payload_kg > 0.0
                          ? "with vehicle.payload_kg, vehicle.max_wheel_torque_Nm"
                          : "vehicle.max_wheel_torque_Nm",
                      vehicle.max_wheel_torque_Nm, [body](const PathDemand& d) {
                        return needed_torque(
                            body, {d.point.v_mps, d.point.omega_radps, d.acceleration_mps2},
                            std::copysign(1.0, d.point.omega_radps) * d.yaw_acceleration_radps2);
                      }});
    limits.push_back({"a friction coefficient",
                      fmt::format("at the drive wheels, which carry {:.0f} % of the weight",
                                  100.0 * axle_load_share(vehicle)),
                      "world.friction", world.friction,
                      [body, gravity_mps2 = world.gravity_mps2](const PathDemand& d) {
                        return needed_friction(
                            body, gravity_mps2,
                            {d.point.v_mps, d.point.omega_radps, d.acceleration_mps2});
                      }});
  }
  return limits;
}

}  // namespace tether
