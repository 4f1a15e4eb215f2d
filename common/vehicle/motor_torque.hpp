#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "common/vehicle/grip.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Acceleration available under load, and motor torque needed for a motion. A motor's torque
/// limit M does not know of the load; the acceleration follows from it.

/// Straight ahead, with both motors at their limit and a force R against the motion (drag, slope):
/// each wheel, a cylinder of ½ m_w r², has ½ m_w r a = M − r F, and the floor pushes the vehicle
/// with 2 F − R = m a, so
///
///   a = (2 M/r − R)/(m + m_w).
///
/// Backwards, to brake, R helps: −R. What the tyres hold is another matter (grip.hpp).
inline double torque_acceleration_mps2(const VehicleConfig& v, double resistance_N = 0.0) {
  const double push_N = 2.0 * v.max_wheel_torque_Nm / v.wheel_radius_m - resistance_N;
  return push_N / (vehicle_weight(v).mass_kg + v.wheel_mass_kg);
}

/// The yaw inertia of all bodies about the upright axis through the axle's midpoint, as the ODE
/// plant has them: a box, balls, and wheels as cylinders that lie across.
inline double yaw_inertia_kgm2(const VehicleConfig& v) {
  const auto square = [](double x) { return x * x; };
  const double box = (square(v.chassis_length_m) + square(v.chassis_width_m)) / 12.0;
  const double wheel = (3.0 * square(v.wheel_radius_m) + square(v.wheel_width_m)) / 12.0;
  return v.chassis_mass_kg * (box + square(v.axle_x_m)) +
         v.caster_mass_kg * (0.4 * square(v.caster_radius_m) + square(v.caster_x_m - v.axle_x_m)) +
         2.0 * v.wheel_mass_kg * (wheel + square(0.5 * v.track_m)) +
         v.payload_kg * (0.4 * square(kPayloadRadius_m) + square(v.payload_x_m - v.axle_x_m) +
                         square(v.payload_y_m));
}

/// The torques of both motors, left and right, for a motion on a level floor without slip: the
/// tyres' forces along (tyre_loads), J dω/dt with J = yaw_inertia_kgm2() shared by both rims, the
/// payload's e m dω/dt, and the wheels' spin. The floor's limit of friction bounds what it can push
/// back: r μ N a wheel.
inline std::array<double, 2> motor_torques(const VehicleConfig& v, const GripDemand& demand,
                                           double yaw_acceleration_radps2) {
  const VehicleWeight w = vehicle_weight(v);
  constexpr double kAnyGravity_mps2 = 9.81;  // forces along do not depend on it
  const TyreLoads t = tyre_loads(v, kAnyGravity_mps2, demand);
  const double turn_N = yaw_inertia_kgm2(v) * yaw_acceleration_radps2 / v.track_m;
  const double left_N = -0.5 * w.mass_kg * w.left_m * yaw_acceleration_radps2;
  std::array<double, 2> torques_Nm{};
  for (const int side : {0, 1}) {
    const double sign = side == 0 ? -1.0 : 1.0;
    const double rim_mps2 =
        demand.acceleration_mps2 + sign * 0.5 * v.track_m * yaw_acceleration_radps2;
    const double floor_N = t.along_N[side] + sign * turn_N + left_N;
    torques_Nm[side] = v.wheel_radius_m * (floor_N + 0.5 * v.wheel_mass_kg * rim_mps2);
  }
  return torques_Nm;
}

/// The larger of both torques, whichever way.
inline double needed_torque(const VehicleConfig& v, const GripDemand& demand,
                            double yaw_acceleration_radps2) {
  const auto [left_Nm, right_Nm] = motor_torques(v, demand, yaw_acceleration_radps2);
  return std::max(std::abs(left_Nm), std::abs(right_Nm));
}

}  // namespace tether
