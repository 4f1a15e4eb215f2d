#include "sim/lidar/lidar_settings.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "common/world/shape.hpp"
#include "sim/lidar/ray_caster.hpp"

namespace tether {
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
