#pragma once

#include <cstddef>
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
  double yaw_radps = 0.0;  ///< error of the yaw rate
  double start_m = 0.0;    ///< error of the position when silence begins, in any direction
  double start_rad = 0.0;  ///< error of the heading at the start
  /// Largest difference between the twists of earlier plans and TubePlan's, which lagging wheels
  /// still have.
  double left_mps = 0.0, left_radps = 0.0;
  double slewing_s = 0.0;  ///< until the wheels have followed a step of the plan, and the actuator
};

/// Twists, each in force for `step_s`. The silence begins after the first `before` of them, which
/// are what wheels that lag have not forgotten; what was in force earlier is the first one. The
/// last `after` ones are for clocks that are ahead when the silence ends.
struct TubePlan {
  std::vector<Twist> twists;
  double step_s = 0.05;
  std::size_t before = 0, after = 0;

  std::size_t steps() const { return twists.size() - before - after; }
  /// `t_s` after the silence began.
  const Twist& at(double t_s) const;
};

/// Where the vehicle is to be at the multiples of `step_s`, from the origin along x, if nothing is
/// wrong: exact arcs.
std::vector<Pose2> planned(const TubePlan& plan);

/// How far from there the vehicle can be at the multiples of `step_s` (one more than steps), m: a
/// guaranteed bound, for errors of radius, track, lag and clock that are constant and disturbances
/// that are not.
///
/// The box of the constant errors is cut into cells. In each, the motion of its centre is
/// integrated; what differs from it is linear in the remaining errors, a zonotope whose generators
/// are carried along (A. Girard: Reachability of uncertain linear systems using zonotopes. HSCC
/// 2005), and of higher order, which is bounded: with a heading off by ε and a speed by ν,
///   |(v + ν) e^{i(θ+ε)} − v e^{iθ} − (ν + i v ε) e^{iθ}| ≤ v ε²/2 + |ν ε|.
/// Shifts in time and lags enter jump by jump. After a jump by J that came s ago, a low-pass
/// with time constant τ still has to cover J ∫_0^∞ e^{−(t+s)/τ} dt = J τ e^{−s/τ}; before one that
/// comes in −s, J (τ − s). This rises with τ and falls with s, so that within a cell it is off by
/// no more than at the cell's two corners; jumps before the silence are what the wheels' initial
/// state differs by. Wheels that take time to follow: a queue of work, in which nothing waits
/// longer than `slewing_s`. The support of the zonotope is taken in 24 directions, and divided by
/// cos(π/24).
std::vector<double> reach_tube(const TubePlan& plan, const TubeBounds& bounds);

}  // namespace tether
