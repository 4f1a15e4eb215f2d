#pragma once

#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// [lidar]: a laser scanner on the vehicle (lidar_model.hpp).
struct LidarSettings {
  static constexpr const char* kNone = "none";
  static constexpr const char* kCustom = "custom";

  std::string model = kNone;                ///< "none", "custom" or the name of a preset
  double rate_hz = 15.0;                    ///< turns
  int beams = 541;                          ///< number per turn
  double fov_rad = 1.5 * std::numbers::pi;  ///< from the first beam to the last, middle ahead; a
                                            ///< whole turn: to the first again
  double range_min_m = 0.05;
  double range_max_m = 25.0;
  double range_10_m = 15.0;  ///< up to here a surface of 10 % reflectivity is seen, from ahead
  // Standard deviation of a range r: √(noise_m² + (noise_per_m · r)²).
  double noise_m = 0.01;
  double noise_per_m = 0.0;
  double range_step_m = 0.001;  ///< ranges are multiples of it; 0: any
  double divergence_rad = 0.0;  ///< a beam's width at 1 m
  double dropout_share = 0.0;   ///< share of beams that return nothing at random
  // Where the scanner is: relative to the axle's midpoint, and above the floor.
  std::optional<double> mount_x_m;  ///< not given: at the chassis' front
  double mount_y_m = 0.0;
  double mount_yaw_rad = 0.0;
  double height_m = 0.2;

  bool on() const { return model != kNone; }
  Duration period() const { return from_seconds(1.0 / rate_hz); }
  bool whole_turn() const { return fov_rad > 2.0 * std::numbers::pi - 1e-9; }
  double angle_increment_rad() const;
  double angle_min_rad() const { return -0.5 * fov_rad; }
  double time_increment_s() const;
  /// From the first beam to the last.
  Duration sweep() const { return from_seconds(time_increment_s() * (beams - 1)); }
  Pose2 mount(const VehicleConfig& vehicle) const;
};

/// The names of presets: scanners that there are (docs/reference/lidar.md has the sources).
std::vector<std::string> lidar_presets();
/// The settings of a preset, or of "custom" or "none" as they are above.
LidarSettings lidar_preset(const std::string& model);

/// Whether the vehicle itself hides what a beam sees, by beam.
std::vector<bool> hidden_beams(const LidarSettings& lidar, const VehicleConfig& vehicle);

/// A preset's settings hold where no key was given. It refuses a scanner that starts within an
/// obstacle or outside the hall, or sees nothing but its own vehicle.
ScenarioSection lidar_section();

}  // namespace tether
