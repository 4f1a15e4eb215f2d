#pragma once

#include <vector>

#include "common/vehicle/pose.hpp"

namespace tether {

/// How wrong a vehicle, its clock and what is known of it may be. All ≥ 0.
struct TubeBounds {
  double radius = 0.0;     ///< |vehicle.radius_error|, below 1
  double track = 0.0;      ///< |vehicle.track_error|, below 1
  double lag_s = 0.0;      ///< time constant of the rims, from 0 on
  double clock_s = 0.0;    ///< |clock offset|
  double speed_mps = 0.0;  ///< |disturbance| of the speed, at any time
  double yaw_radps = 0.0;  ///< of the yaw rate
  double start_m = 0.0;    ///< of where it is when silence begins, in any direction
  double start_rad = 0.0;  ///< of where it heads then
  double slewing_s = 0.0;  ///< until the wheels have followed a step of the plan, and the actuator
};

/// The twists of a plan, each in force for `step_s` from the beginning of the silence on; before,
/// the first one.
struct TubePlan {
  std::vector<Twist> twists;
  double step_s = 0.05;
};

/// Where the vehicle is to be at the multiples of `step_s`, from the origin along x, if nothing is
/// wrong: exact arcs.
std::vector<Pose2> planned(const TubePlan& plan);

/// How far from there the vehicle can be at the multiples of `step_s` (one more than twists), m: a
/// guaranteed bound, for errors of radius, track, lag and clock that are constant and disturbances
/// that are not.
///
/// The box of the constant errors is cut into cells. In each, the motion of its centre is
/// integrated; what differs from it is linear in the remaining errors, a zonotope whose generators
/// are carried along (A. Girard: Reachability of uncertain linear systems using zonotopes. HSCC
/// 2005), and of higher order, which is bounded: with a heading off by ε and a speed by ν,
///   |(v + ν) e^{i(θ+ε)} − v e^{iθ} − (ν + i v ε) e^{iθ}| ≤ v ε²/2 + |ν ε|.
/// Shifts in time and lags enter by the total variation TV of the twists: ∫|u(t + s) − u(t)| ≤
/// |s|·TV, and likewise for low-passes whose time constants differ by s. The support of the
/// zonotope is taken in 24 directions, and divided by cos(π/24).
std::vector<double> reach_tube(const TubePlan& plan, const TubeBounds& bounds);

}  // namespace tether
