#pragma once

#include "common/vehicle/pose.hpp"

namespace tether {

/// A payload is a point for all but its own inertia, that of a ball of this size.
inline constexpr double kPayloadRadius_m = 0.1;

/// The vehicle: a differential drive with a passive caster in front (PIMRC 2025 paper, section
/// "Vehicle"). Positions are relative to the chassis centre, which rides chassis_z_m above the
/// axle. The vehicle's *pose* is that of the axle's midpoint.
struct VehicleConfig {
  double chassis_length_m = 2.0;
  double chassis_width_m = 1.0;
  double chassis_height_m = 0.5;
  double chassis_mass_kg = 1.14395;
  double chassis_z_m = 0.0;  ///< height of the chassis centre, above the axle
  double wheel_radius_m = 0.4;
  double wheel_width_m = 0.2;
  double wheel_mass_kg = 1.0;
  double track_m = 1.2;     ///< between wheel centres
  double axle_x_m = -0.5;   ///< position of the axle, relative to the chassis centre
  double caster_x_m = 0.8;  ///< position of the caster ball, relative to the chassis centre
  double caster_radius_m = 0.2;
  double caster_mass_kg = 0.2688;  ///< puts the centre of mass at x = −0.23 m, the paper's C
  // A load: a point, relative to the chassis centre; not there if it weighs nothing.
  double payload_kg = 0.0;
  double payload_x_m = 0.0;
  double payload_y_m = 0.0;
  double payload_z_m = 0.0;
  /// Limits of each wheel's speed servo. One and a half times what the whole vehicle needs for 3
  /// m/s², and little more than makes the wheels slip. So wheels that are jammed at a wall do not
  /// spin up.
  double max_wheel_torque_Nm = 4.0;
  /// Slew rate of each servo's rim-speed target. The chassis would lift its nose at 5.4 m/s².
  double max_wheel_acceleration_mps2 = 3.0;
  // Unmodelled friction at each wheel's rim, against its motion.
  double left_drag_N = 0.0;
  double right_drag_N = 0.0;
  double max_wheel_speed_mps = 10.0;  ///< rim speed; both wheels are scaled together
  /// Each ramp begins at its wheel's speed, not at its target before: so no target runs ahead of a
  /// wheel whose motor gives all it can, and a load leaves the acceleration of motor_torque.hpp.
  bool anti_windup = false;
  /// How tyres hold: as ball joints up to the limit of friction, or as brushes that yield
  /// (sim/plant/ode_world.cpp).
  enum class Tyre { rigid, brush };
  Tyre tyre = Tyre::rigid;
  /// Force over load by slip, of a brush that does not slide. Assumed: solid tyres' data sheets do
  /// not say; car tyres have 10 to 30.
  double tyre_stiffness = 20.0;
  /// A brush's relaxation length, half the length of its contact. Assumed.
  double tyre_relaxation_m = 0.02;
  double start_x_m = 0.0;
  double start_y_m = 0.0;
  double start_yaw_rad = 0.0;

  /// Where it begins, but for the errors of the start (VehicleSettings).
  Pose2 start_pose() const { return {start_x_m, start_y_m, wrap_angle(start_yaw_rad)}; }
};

}  // namespace tether
