#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Weight of the vehicle, and the share on its drive wheels.
///
/// Axes: x forward and y left of the axle's midpoint, z up from the floor. The vehicle stands on
/// two tyres at (0, ±track/2) and a caster at (L, 0), L = caster_x_m − axle_x_m. The caster is
/// frictionless: it carries weight, and holds nothing.
struct VehicleWeight {
  double mass_kg = 0.0;
  double ahead_m = 0.0;   ///< the centre of mass, from the axle
  double left_m = 0.0;    ///< the centre of mass
  double height_m = 0.0;  ///< the centre of mass, above the floor
  // Products of the masses' places: where masses are low in front and high behind, a turn tips
  // less.
  double ahead_height_kgm2 = 0.0;  ///< Σ m x z
  double left_height_kgm2 = 0.0;   ///< Σ m y z
};

/// Weight of all bodies and the payload, as in the ODE plant.
inline VehicleWeight vehicle_weight(const VehicleConfig& v) {
  VehicleWeight w;
  const auto add = [&w](double kg, double x_m, double y_m, double z_m) {
    w.mass_kg += kg;
    w.ahead_m += kg * x_m;
    w.left_m += kg * y_m;
    w.height_m += kg * z_m;
    w.ahead_height_kgm2 += kg * x_m * z_m;
    w.left_height_kgm2 += kg * y_m * z_m;
  };
  const double chassis_z_m = v.wheel_radius_m + v.chassis_z_m;
  add(v.chassis_mass_kg, -v.axle_x_m, 0.0, chassis_z_m);
  add(v.caster_mass_kg, v.caster_x_m - v.axle_x_m, 0.0, v.caster_radius_m);
  add(2.0 * v.wheel_mass_kg, 0.0, 0.0, v.wheel_radius_m);
  add(v.payload_kg, v.payload_x_m - v.axle_x_m, v.payload_y_m, chassis_z_m + v.payload_z_m);
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

/// A steady demand: speed and yaw rate at the axle's midpoint, and how fast the speed changes.
struct GripDemand {
  double v_mps = 0.0;
  double omega_radps = 0.0;
  double acceleration_mps2 = 0.0;
};

/// Forces of the floor on the tyres for a demand.
struct TyreLoads {
  double across_N = 0.0;                  ///< both tyres together, to the left
  std::array<double, 2> along_N = {};     ///< left, right; positive pushes the vehicle forward
  std::array<double, 2> pressing_N = {};  ///< left, right
};

/// Newton and Euler for a vehicle that turns steadily (dω/dt = 0, no slip, small tilt), all moments
/// about the floor below the axle's middle. With the centre of mass (d, e) ahead and to the left,
/// height h, and S_x = Σ m x z, S_y = Σ m y z:
///
///   forces   F_xl + F_xr = m (dv/dt − ω²d),   F_y = m (v ω − ω²e)
///   yaw      (F_xr − F_xl) track/2 = m d v ω − m e dv/dt
///   pitch    N L = m g (L − d) + (m h + m_w r) dv/dt − ω² S_x,   N = N_l + N_r
///   roll     (N_l − N_r) track/2 = m g e − (m h + m_w r) v ω + ω² S_y
///
/// The mass at x has the acceleration dv/dt − ω²x forward and v ω to the left, and these act at its
/// height. The terms with m_w are of the wheels' spin, ½ m_w r² v/r each: of what it takes to
/// change it, and to turn it round with the vehicle. Any text on rigid bodies has these balances. A
/// test compares them with ODE's forces.
inline TyreLoads tyre_loads(const VehicleConfig& v, double gravity_mps2, const GripDemand& demand) {
  const VehicleWeight w = vehicle_weight(v);
  const double m = w.mass_kg;
  const double a = demand.acceleration_mps2;
  const double turn = demand.v_mps * demand.omega_radps;
  const double omega2 = demand.omega_radps * demand.omega_radps;
  const double lever_m = v.caster_x_m - v.axle_x_m;
  const double along_N = m * (a - omega2 * w.ahead_m);
  const double apart_N = 2.0 * m * (w.ahead_m * turn - w.left_m * a) / v.track_m;
  const double spin_kgm = v.wheel_mass_kg * v.wheel_radius_m;
  const double height_kgm = m * w.height_m + spin_kgm;
  const double pitch_Nm =
      m * gravity_mps2 * (lever_m - w.ahead_m) + height_kgm * a - omega2 * w.ahead_height_kgm2;
  const double axle_N = lever_m == 0.0 ? m * gravity_mps2 : pitch_Nm / lever_m;
  const double roll_Nm =
      m * gravity_mps2 * w.left_m - height_kgm * turn + omega2 * w.left_height_kgm2;
  const double shift_N = 2.0 * roll_Nm / v.track_m;
  return {.across_N = m * (turn - omega2 * w.left_m),
          .along_N = {0.5 * (along_N - apart_N), 0.5 * (along_N + apart_N)},
          .pressing_N = {0.5 * (axle_N + shift_N), 0.5 * (axle_N - shift_N)}};
}

/// The coefficient of friction that the tyres need for a demand; infinite if a tyre or the caster
/// would have to pull at the floor, so that the vehicle lifts off.
///
/// Both tyres are on one stiff axle, so that they share F_y as their grip allows; each has to give
/// its F_x.
/// - "brush": circles with the tyres' loads as they are: the least μ with Σ √(μ²N_i² − F_xi²) ≥
///   |F_y|.
/// - "rigid": ODE's pyramid, so that along and across count separately, with the loads at rest:
///   μ = max(|F_y|/(N_l + N_r), |F_xl|/N_l, |F_xr|/N_r). For dWorldStep takes its limits of
///   friction from the normal forces that it finds before it looks at friction. Where F_y decides,
///   which is on all but the tightest turns, v ω = μ g (axle's share of the load).
inline double needed_friction(const VehicleConfig& v, double gravity_mps2,
                              const GripDemand& demand) {
  const TyreLoads t = tyre_loads(v, gravity_mps2, demand);
  const bool lifts = !(t.pressing_N[0] > 0.0 && t.pressing_N[1] > 0.0) ||
                     t.pressing_N[0] + t.pressing_N[1] > vehicle_weight(v).mass_kg * gravity_mps2;
  if (lifts) return std::numeric_limits<double>::infinity();
  const bool is_rigid = v.tyre == VehicleConfig::Tyre::rigid;
  const std::array<double, 2> n =
      is_rigid ? tyre_loads(v, gravity_mps2, {}).pressing_N : t.pressing_N;
  const double across = std::abs(t.across_N) / (n[0] + n[1]);
  const double along = std::max(std::abs(t.along_N[0]) / n[0], std::abs(t.along_N[1]) / n[1]);
  if (is_rigid) return std::max(across, along);
  const auto holds = [&](double friction) {
    double sum_N = 0.0;
    for (const int side : {0, 1}) {
      const double grip_N = friction * n[side];
      sum_N += std::sqrt(std::max(0.0, grip_N * grip_N - t.along_N[side] * t.along_N[side]));
    }
    return sum_N >= std::abs(t.across_N);
  };
  double low = std::max(across, along), high = across + along;  // a circle is within their sum
  for (int i = 0; i < 50 && high - low > 1e-12; ++i) {
    const double middle = 0.5 * (low + high);
    (holds(middle) ? high : low) = middle;
  }
  return high;
}

/// The lateral acceleration v ω that the tyres can hold at most, of a vehicle that turns steadily
/// at `omega_radps` (0: on a very large circle).
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
