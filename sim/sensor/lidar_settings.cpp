#include "sim/sensor/lidar_settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <tether/scan_t.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/shape.hpp"
#include "common/world/surroundings.hpp"
#include "sim/sensor/ray_caster.hpp"

namespace tether {
namespace {

using Lidar = LidarSettings;

constexpr Range kAngle{-100.0, 100.0, false};
constexpr Range kMount{-100.0, 100.0, false};

std::vector<ScenarioKey> lidar_keys() {
  KeyTable<Lidar> t("lidar.");
  std::vector<std::string> models{Lidar::kNone, Lidar::kCustom};
  for (const std::string& preset : lidar_presets()) models.push_back(preset);
  t.one_of("model", &Lidar::model, models,
           "laser scanner; a preset sets the keys below that are not given");
  t.number("rate_hz", &Lidar::rate_hz, kRate, "turns per second");
  t.whole_number("beams", &Lidar::beams, 1, "number of beams per revolution, at most 8192");
  t.number("fov_rad", &Lidar::fov_rad, {0.0, 2.0 * std::numbers::pi, true},
           "angle from the first beam to the last; the middle one points ahead");
  t.number("range_min_m", &Lidar::range_min_m, {0.0, 1e3, false}, "minimum measured range");
  t.number("range_max_m", &Lidar::range_max_m, {1e-3, 1e3, false}, "maximum measured range");
  t.number("range_10_m", &Lidar::range_10_m, {1e-3, 1e4, false},
           "maximum range of a surface that reflects 10 % of the light, at normal incidence");
  t.number("noise_m", &Lidar::noise_m, {0.0, 10.0, false}, "standard deviation of a range");
  t.number("noise_per_m", &Lidar::noise_per_m, {0.0, 1.0, false},
           "standard deviation that grows with the range, in addition");
  t.number("range_step_m", &Lidar::range_step_m, {0.0, 1.0, false},
           "resolution of ranges; 0 = continuous");
  t.number("divergence_rad", &Lidar::divergence_rad, {0.0, 0.1, false},
           "width of a beam at 1 m, which mixes two surfaces at edges");
  t.number("dropout_share", &Lidar::dropout_share, kRatio,
           "share of beams that return nothing, at random");
  t.optional_number("mount_x_m", &Lidar::mount_x_m, kMount,
                    "scanner's position ahead of the axle; not given: the chassis' front");
  t.number("mount_y_m", &Lidar::mount_y_m, kMount, "scanner's position to the left");
  t.number("mount_yaw_rad", &Lidar::mount_yaw_rad, kAngle, "scanner's yaw");
  t.number("height_m", &Lidar::height_m, {0.01, 100.0, false},
           "height of the scan plane above the floor");
  return t.take();
}

/// Given keys take precedence over the preset.
void complete(Scenario& scenario, const std::set<std::string>& given, const std::string&) {
  Scenario preset = scenario;
  preset.get<Lidar>() = lidar_preset(scenario.get<Lidar>().model);
  for (const ScenarioKey& key : lidar_keys()) {
    const auto value = key.get(preset);
    if (!given.contains(key.name) && value) key.set(scenario, *value);
  }
}

void check_numbers(const Scenario& scenario, const std::string& file) {
  const auto& lidar = scenario.get<Lidar>();
  if (lidar.beams > scan_t::MAX_COUNT) {
    throw UsageError(fmt::format("{}: lidar.beams = {} must be a whole number from 1 to {}", file,
                                 lidar.beams, scan_t::MAX_COUNT));
  }
  if (lidar.range_min_m >= lidar.range_max_m) {
    throw UsageError(fmt::format("{}: lidar.range_min_m = {} must be below lidar.range_max_m = {}",
                                 file, lidar.range_min_m, lidar.range_max_m));
  }
  const auto& world = scenario.get<WorldSettings>();
  if (lidar.period() < step_of(world)) {
    throw UsageError(
        fmt::format("{}: lidar.rate_hz = {} asks for more than one turn a step: world.step_ms = {}",
                    file, lidar.rate_hz, world.step_ms));
  }
}

void check_place(const Scenario& scenario, const std::string& file) {
  const auto& lidar = scenario.get<Lidar>();
  const auto& vehicle = scenario.get<VehicleSettings>();
  const Pose2 mount = lidar.mount(vehicle);
  const std::vector<bool> hidden = hidden_beams(lidar, vehicle);
  if (std::all_of(hidden.begin(), hidden.end(), [](bool h) { return h; })) {
    throw UsageError(fmt::format(
        "{}: the scanner at lidar.mount_x_m = {}, mount_y_m = {}, height_m = {} sees nothing but "
        "its own vehicle; put it at the chassis' edge or above it",
        file, mount.x_m, mount.y_m, lidar.height_m));
  }
  const double c = std::cos(vehicle.start_yaw_rad), s = std::sin(vehicle.start_yaw_rad);
  const Position start{vehicle.start_x_m + c * mount.x_m - s * mount.y_m,
                       vehicle.start_y_m + s * mount.x_m + c * mount.y_m};
  const double half_extent_m = scenario.get<WorldSettings>().half_extent_m;
  if (std::max(std::abs(start.x_m), std::abs(start.y_m)) >= half_extent_m) {
    throw UsageError(fmt::format(
        "{}: the scanner starts at ({:.2f}, {:.2f}) m, in or beyond a wall: lidar.mount_x_m = {}, "
        "mount_y_m = {} must have it within ±{} m (world.half_extent_m)",
        file, start.x_m, start.y_m, mount.x_m, mount.y_m, half_extent_m));
  }
  for (const Shape& shape : standing_shapes(scenario)) {
    if (!shape.is_at(lidar.height_m) || distance_m(shape, start) > 0.0) continue;
    throw UsageError(fmt::format(
        "{}: the scanner starts at ({:.2f}, {:.2f}) m, in an obstacle at ({:.2f}, {:.2f}) m; move "
        "it (lidar.mount_x_m, mount_y_m, height_m), the vehicle's start or the obstacle",
        file, start.x_m, start.y_m, shape.pose.x_m, shape.pose.y_m));
  }
}

void check_lidar(const Scenario& scenario, const std::string& file) {
  if (!scenario.get<Lidar>().on()) return;
  check_numbers(scenario, file);
  check_place(scenario, file);
}

}  // namespace

ScenarioSection lidar_section() {
  ScenarioSection section{.defaults = Lidar{}, .keys = lidar_keys()};
  for (const ScenarioKey& key : section.keys) {
    if (key.name == "lidar.model") continue;
    section.switched.push_back({key.name, {"lidar.model"}, std::string(Lidar::kNone)});
  }
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    return key.name == "lidar.model" && !scenario.get<Lidar>().on();
  };
  section.complete = complete;
  section.check = check_lidar;
  return section;
}

namespace {

constexpr double kDegree_rad = std::numbers::pi / 180.0;
constexpr double kEdge_m = 1e-3;  ///< a scanner at the vehicle's very edge looks along it

/// Values that docs/reference/lidar.md calls assumed have no source.
LidarSettings sick_nanoscan3() {
  LidarSettings s;
  s.model = "sick_nanoscan3";
  s.rate_hz = 1.0 / 0.03;
  s.beams = 1651;
  s.fov_rad = 275.0 * kDegree_rad;
  s.range_min_m = 0.05;
  s.range_max_m = 40.0;
  s.range_10_m = 10.0;  // assumed
  s.noise_m = 0.01;     // assumed
  s.range_step_m = 0.001;
  s.divergence_rad = 0.0029;  // assumed: as wide as its beams are apart
  return s;
}

LidarSettings sick_lms111() {
  LidarSettings s;
  s.model = "sick_lms111";
  s.rate_hz = 50.0;
  s.beams = 541;
  s.fov_rad = 270.0 * kDegree_rad;
  s.range_min_m = 0.5;
  s.range_max_m = 20.0;
  s.range_10_m = 18.0;
  s.noise_m = 0.012;
  s.range_step_m = 0.001;
  s.divergence_rad = 0.015;
  return s;
}

constexpr std::array kPresets{&sick_nanoscan3, &sick_lms111};

/// The vehicle in its own frame, cut at that height: chassis and wheels, less kEdge_m all around.
std::vector<Shape> own_shapes(const VehicleConfig& vehicle, double height_m) {
  const auto cut = [](double x_m, double y_m, double length_m, double width_m) {
    return Shape{.pose = {x_m, y_m, 0.0},
                 .length_m = std::max(length_m - 2.0 * kEdge_m, kEdge_m),
                 .width_m = std::max(width_m - 2.0 * kEdge_m, kEdge_m),
                 .height_m = 1e9};
  };
  std::vector<Shape> shapes;
  const double above_axle_m = height_m - vehicle.wheel_radius_m;
  if (std::abs(above_axle_m - vehicle.chassis_z_m) <= 0.5 * vehicle.chassis_height_m) {
    shapes.push_back(
        cut(-vehicle.axle_x_m, 0.0, vehicle.chassis_length_m, vehicle.chassis_width_m));
  }
  const double half2 =
      vehicle.wheel_radius_m * vehicle.wheel_radius_m - above_axle_m * above_axle_m;
  if (half2 > 0.0) {
    for (const double side : {-0.5, 0.5}) {
      shapes.push_back(
          cut(0.0, side * vehicle.track_m, 2.0 * std::sqrt(half2), vehicle.wheel_width_m));
    }
  }
  return shapes;
}

}  // namespace

double LidarSettings::angle_increment_rad() const {
  return fov_rad / std::max(whole_turn() ? beams : beams - 1, 1);
}

double LidarSettings::time_increment_s() const {
  return angle_increment_rad() / (2.0 * std::numbers::pi * rate_hz);
}

Pose2 LidarSettings::mount(const VehicleConfig& vehicle) const {
  const double front_m = 0.5 * vehicle.chassis_length_m - vehicle.axle_x_m;
  return {mount_x_m.value_or(front_m), mount_y_m, mount_yaw_rad};
}

std::vector<std::string> lidar_presets() {
  std::vector<std::string> names;
  for (const auto& preset : kPresets) names.push_back(preset().model);
  return names;
}

LidarSettings lidar_preset(const std::string& model) {
  for (const auto& preset : kPresets) {
    if (preset().model == model) return preset();
  }
  LidarSettings settings;
  settings.model = model;
  return settings;
}

std::vector<bool> hidden_beams(const LidarSettings& lidar, const VehicleConfig& vehicle) {
  const std::vector<Shape> own = own_shapes(vehicle, lidar.height_m);
  const Pose2 mount = lidar.mount(vehicle);
  RayFan fan;
  for (int i = 0; i < lidar.beams; ++i) {
    const double angle_rad = lidar.angle_min_rad() + i * lidar.angle_increment_rad();
    fan.add({mount.x_m, mount.y_m}, mount.yaw_rad + angle_rad, 0.0);
  }
  RayCaster(own, lidar.height_m).cast(fan, lidar.range_max_m);
  std::vector<bool> hidden;
  for (const std::int64_t shape : fan.shape) hidden.push_back(shape != RayFan::kNoShape);
  return hidden;
}

}  // namespace tether
