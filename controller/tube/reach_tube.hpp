#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/scenario/section.hpp"
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

/// [tube]: how wrong the vehicle may be, for the guaranteed tube of a plan's execution.
struct TubeSettings {
  double silence_s = 0.0;  ///< how long after the beginning of a plan; 0: no tube
  TubeBounds bounds;
};

ScenarioSection tube_section();

/// The worst place of a scenario's path: how far from where its plan means it to be a vehicle
/// within the bounds can be, after a silence that begins anywhere from run.settled_from_s on. Plans
/// are the path's own twists (those of the laws that plan, once they are on it), in steps of
/// controller.plan_step_ms. Steps of a tube are the plan's.
struct PathTube {
  double step_s = 0.05;
  std::vector<double> deviation_m;  ///< after so many steps

  double after_m(double silence_s) const;
};

/// Silences up to `silence_s`, which begin every 0.1 s. Throws UsageError unless actuator.policy
/// is "horizon", and if the wheels cannot turn as fast as the path asks.
PathTube path_tube(const Scenario& scenario, double silence_s);

/// The longest silence in which the deviation surely stays within some distance.
struct LongestSilence {
  double silence_s = 0.0;  ///< 0: none
  double at_once_m = 0.0;  ///< the deviation when a silence begins
  bool or_longer = false;  ///< it is as long as was looked at: 16 s, or the plan
};

/// `budget_m` > 0. Throws as path_tube() does.
LongestSilence longest_silence(const Scenario& scenario, double budget_m);

/// After tube.silence_s; nullopt with 0.
std::optional<double> tube_m(const Scenario& scenario);

/// The plan of a silence that begins at `from_s`, and the path's twists before, until lagging
/// wheels have forgotten them. Before the path begins, the vehicle is on its first twist.
TubePlan plan_along(const Scenario& scenario, const ReferencePath& path, double from_s,
                    double silence_s);
/// The bounds of [tube], with what the wheels' acceleration and the step of the plant do. Throws
/// UsageError if the wheels cannot turn as fast as the plan asks.
TubeBounds tube_bounds(const Scenario& scenario, const TubePlan& plan);

}  // namespace tether
