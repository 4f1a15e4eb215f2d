#pragma once

#include <optional>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/scenario/section.hpp"
#include "controller/tube/reach_tube.hpp"

namespace tether {

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
