#pragma once

#include <string>

#include "common/base/time.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// [world]: a flat floor with four walls around the origin.
struct WorldSettings {
  double half_extent_m = 22.0;  ///< walls at x = ±half_extent_m and y = ±half_extent_m
  /// Coulomb coefficient of tyres on the floor: polyurethane on concrete. From about 0.8 on, the
  /// tyres hold well enough to tip the vehicle over when it skids sideways at 8 m/s.
  double friction = 0.6;
  /// Coulomb coefficient of body and wheels on walls. A wheel that rubs a rough wall climbs it.
  double wall_friction = 0.2;
  double gravity_mps2 = 9.81;
  double step_ms = 1.0;  ///< step of the physics
  // By how much the floor rises along x and y, m/m. Positions stay in the floor's frame.
  double slope_x = 0.0;
  double slope_y = 0.0;
  // Bumps, half sines (sim/plant/disturbances.hpp).
  double bump_spacing_m = 0.0;  ///< each wheel's mean way between two; 0: none
  double bump_height_m = 0.01;
  double bump_length_m = 0.2;
};

inline Duration step_of(const WorldSettings& world) { return from_seconds(world.step_ms * 1e-3); }

/// [vehicle]
struct VehicleSettings : VehicleConfig {
  enum class Plant { ode, kinematic };
  enum class Drivetrain { direct, can };
  Plant plant = Plant::ode;
  /// The key's value, as written in files.
  const char* plant_name() const { return plant == Plant::kinematic ? "kinematic" : "ode"; }
  /// Converter of commands to wheel speeds: the simulator itself, or drives on a CAN bus.
  Drivetrain drivetrain = Drivetrain::direct;
  /// can.coupling_ms: interval between messages of emulated drives and simulated wheels.
  double coupling_ms = 5.0;
  std::string name = "AGV";  ///< first part of its LCM channels
  // Standard deviations of where it really stands at t = 0 from start_x_m, … (each axis) and
  // start_yaw_rad (sim/plant/true_start.hpp), which is all that the controller knows.
  double start_error_m = 0.0;
  double start_error_rad = 0.0;
  // Errors that neither the vehicle nor the controller knows of (sim/plant/drive_errors.hpp). With
  // drives on CAN they have no effect.
  double radius_error = 0.0;     ///< share by which the wheels are larger than it believes
  double track_error = 0.0;      ///< share by which it believes in too wide a track
  double actuator_lag_ms = 0.0;  ///< time constant of its rim speeds
  double clock_offset_ms = 0.0;  ///< its clock is ahead of the run's, and the controller's, by this
};

/// No start is farther off than this many of vehicle.start_error_m and start_error_rad.
inline constexpr double kStartErrorSigmas = 3.0;

ScenarioSection world_section();
ScenarioSection vehicle_section();

/// The earliest time stamp that belongs to this run, even if clocks do not agree.
Instant earliest_stamp(const Sections<RunSettings, VehicleSettings>& settings);

}  // namespace tether
