#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// What the vehicle weighs, and how much of it its drive wheels carry.
///
/// Axes: x forward and y left of the axle's midpoint, z up from the floor. The vehicle stands on two
/// tyres at (0, ±track/2) and a caster at (L, 0), L = caster_x_m − axle_x_m. The caster is
/// frictionless: it carries weight, and holds nothing.
struct VehicleWeight {
  double mass_kg = 0.0;
  double ahead_m = 0.0;   ///< the centre of mass, from the axle
  double left_m = 0.0;    ///< the centre of mass
  double height_m = 0.0;  ///< the centre of mass, above the floor
};

/// Of all bodies and the payload, as the ODE plant has them: the chassis and the payload ride at the
/// axle's height.
inline VehicleWeight vehicle_weight(const VehicleConfig& v) {
  VehicleWeight w;
  const auto add = [&w](double kg, double x_m, double y_m, double z_m) {
    w.mass_kg += kg;
    w.ahead_m += kg * x_m;
    w.left_m += kg * y_m;
    w.height_m += kg * z_m;
  };
  add(v.chassis_mass_kg, -v.axle_x_m, 0.0, v.wheel_radius_m);
  add(v.caster_mass_kg, v.caster_x_m - v.axle_x_m, 0.0, v.caster_radius_m);
  add(2.0 * v.wheel_mass_kg, 0.0, 0.0, v.wheel_radius_m);
  add(v.payload_kg, v.payload_x_m - v.axle_x_m, v.payload_y_m, v.wheel_radius_m);
  w.ahead_m /= w.mass_kg;
  w.left_m /= w.mass_kg;
  w.height_m /= w.mass_kg;
  return w;
}

/// The share of the weight that the drive wheels carry at rest: (L − d)/L with the centre of mass d
/// ahead of the axle; 1 if there is no lever, L = 0.
inline double axle_load_share(const VehicleConfig& v) {
  const double lever_m = v.caster_x_m - v.axle_x_m;
  return lever_m == 0.0 ? 1.0 : 1.0 - vehicle_weight(v).ahead_m / lever_m;
}

/// The share of max_wheel_acceleration_mps2 that is left with the payload: (m_empty / m)^load_scaling.
/// 0: a load changes nothing, 1: the drives give each load the same force.
inline double loaded_acceleration_share(const VehicleConfig& v) {
  if (v.load_scaling == 0.0 || v.payload_kg == 0.0) return 1.0;
  const double mass_kg = vehicle_weight(v).mass_kg;
  return std::pow((mass_kg - v.payload_kg) / mass_kg, v.load_scaling);
}

/// A steady demand: speed and yaw rate at the axle's midpoint, and how fast the speed changes.
struct GripDemand {
  double v_mps = 0.0;
  double omega_radps = 0.0;
  double acceleration_mps2 = 0.0;
};

/// What the floor must do at the tyres for a demand.
struct TyreLoads {
  double across_N = 0.0;      ///< both tyres together
  double along_N[2] = {};     ///< left, right; positive pushes the vehicle forward
  double pressing_N[2] = {};  ///< left, right
};

/// Newton and Euler for one rigid body that turns steadily (dω/dt = 0, small tilt). With the centre
/// of mass at (d, e), height h:
///
///   its acceleration     a_x = dv/dt − ω²d,  a_y = v ω − ω²e
///   forces               F_y = m a_y,        F_xl + F_xr = m a_x
///   yaw, about it        (F_xr − F_xl) track/2 = d F_y − e m a_x: the tyres hold behind it
///   pitch, about the caster   N L = m g (L − d) + m a_x h,  N = N_l + N_r
///   roll, about the axle's middle   (N_l − N_r) track/2 = m g e − m a_y h
///
/// These are balances of forces of a body on three supports; any text on mechanics has them. That
/// the wheels spin about their axles is left out: their moment is part of the servos'.
inline TyreLoads tyre_loads(const VehicleConfig& v, double gravity_mps2, const GripDemand& demand) {
  const VehicleWeight w = vehicle_weight(v);
  const double omega2 = demand.omega_radps * demand.omega_radps;
  const double ax = demand.acceleration_mps2 - omega2 * w.ahead_m;
  const double ay = demand.v_mps * demand.omega_radps - omega2 * w.left_m;
  const double lever_m = v.caster_x_m - v.axle_x_m;
  const double pitch_mps2 =
      lever_m == 0.0 ? gravity_mps2
                     : (gravity_mps2 * (lever_m - w.ahead_m) + ax * w.height_m) / lever_m;
  const double roll_mps2 = 2.0 * (gravity_mps2 * w.left_m - ay * w.height_m) / v.track_m;
  const double turn_mps2 = 2.0 * (w.ahead_m * ay - w.left_m * ax) / v.track_m;
  const double half_kg = 0.5 * w.mass_kg;
  TyreLoads loads;
  loads.across_N = w.mass_kg * ay;
  loads.along_N[0] = half_kg * (ax - turn_mps2);
  loads.along_N[1] = half_kg * (ax + turn_mps2);
  loads.pressing_N[0] = half_kg * (pitch_mps2 + roll_mps2);
  loads.pressing_N[1] = half_kg * (pitch_mps2 - roll_mps2);
  return loads;
}

/// The coefficient of friction that the tyres need for a demand; infinite if a tyre or the caster
/// would have to pull at the floor, so that the vehicle lifts off.
///
/// Both tyres are on one stiff axle, so that they share F_y as their grip allows; each has to give
/// its F_x. With vehicle.tyre = "rigid" the limits along and across are separate (ODE's pyramid):
/// μ = max(|F_y|/N, |F_xl|/N_l, |F_xr|/N_r). With "brush" they are circles: the least μ with
/// Σ √(μ²N_i² − F_xi²) ≥ |F_y|.
inline double needed_friction(const VehicleConfig& v, double gravity_mps2,
                              const GripDemand& demand) {
  const TyreLoads t = tyre_loads(v, gravity_mps2, demand);
  const double axle_N = t.pressing_N[0] + t.pressing_N[1];
  const bool lifts = !(t.pressing_N[0] > 0.0 && t.pressing_N[1] > 0.0) ||
                     axle_N > vehicle_weight(v).mass_kg * gravity_mps2;
  if (lifts) return std::numeric_limits<double>::infinity();
  const double across_N = std::abs(t.across_N);
  const double along = std::max(std::abs(t.along_N[0]) / t.pressing_N[0],
                                std::abs(t.along_N[1]) / t.pressing_N[1]);
  const double separate = std::max(across_N / axle_N, along);
  if (v.tyre == VehicleConfig::Tyre::rigid) return separate;
  const auto holds = [&](double friction) {
    double sum_N = 0.0;
    for (const int side : {0, 1}) {
      const double grip_N = friction * t.pressing_N[side];
      sum_N += std::sqrt(std::max(0.0, grip_N * grip_N - t.along_N[side] * t.along_N[side]));
    }
    return sum_N >= across_N;
  };
  double low = separate, high = across_N / axle_N + along;  // the sum is never too little
  for (int i = 0; i < 50 && high - low > 1e-12; ++i) {
    const double middle = 0.5 * (low + high);
    (holds(middle) ? high : low) = middle;
  }
  return high;
}

/// The lateral acceleration v ω at which the tyres begin to slip, of a vehicle that turns steadily
/// at `omega_radps` (0: on a very large circle) and not faster and faster.
inline double lateral_grip_mps2(const VehicleConfig& v, double friction, double gravity_mps2,
                                double omega_radps) {
  double low = 0.0, high = friction * gravity_mps2;
  // v and ω appear only as v ω and ω²; a large circle is one with a tiny ω.
  const double omega = std::max(std::abs(omega_radps), 1e-6);
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    const bool holds = needed_friction(v, gravity_mps2, {middle / omega, omega, 0.0}) <= friction;
    (holds ? low : high) = middle;
  }
  return low;
}

}  // namespace tether
