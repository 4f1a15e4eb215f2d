#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "tools/margin/survival.hpp"

namespace tether {

/// Mean and 95 % interval of settled_epsilon_m, the mean distance to the reference from
/// run.settled_from_s on, of some runs of the whole loop on the scenario's own path.
struct SettledError {
  double mean_m = 0.0;
  double half_width_m = 0.0;
};

/// `seeds` ≥ 2, from 1 on; `jobs` threads. Throws std::runtime_error if a run fails.
SettledError settled_error(const Scenario& scenario, std::size_t seeds, std::size_t jobs);

/// When runs with seeds from 1 on are farther than run.lost_beyond_m from the path for the first
/// time. Throws std::runtime_error if one fails.
FirstExcursion first_excursion_of_runs(const Scenario& scenario, std::size_t seeds,
                                       std::size_t jobs);

/// Search of tether margin --find.
struct DesignQuestion {
  std::string file;
  std::vector<std::string> overrides;
  std::string what;        ///< rate, tau, horizon, gains
  double target_m = 0.05;  ///< target of the mean distance after the start
  std::size_t seeds = 20;  ///< seeds of the check
  std::size_t jobs = 1;
};

/// One candidate, as it was computed and as runs have it.
struct DesignStep {
  std::vector<std::string> set;  ///< "KEY=VALUE"
  std::string predicted;         ///< in words
  SettledError simulated;
  bool good = false;  ///< the interval's upper end is within the target
};

struct DesignAnswer {
  std::vector<DesignStep> tried;  ///< the last is the answer, if that is good
  std::string why_none;           ///< why nothing was tried or is good
  bool found() const { return !tried.empty() && tried.back().good; }
};

/// - rate: the lowest sensor.rate_hz at which the predicted rms error is within the target;
/// - tau: controller.tau_s with the least predicted rms error (law = "pid");
/// - gains: controller.tracking.k_y and k_theta = 2√k_y·ζ with the least predicted rms error;
/// - horizon: the shortest controller.horizon_s that lasts for all but one in 1000 silences of the
///   channel's chain (laws that plan, policy = "horizon").
/// What is predicted is then simulated, on the scenario's own path; rate and horizon go on to the
/// next longer or higher value while runs miss the target. Throws UsageError for scenarios that the
/// theory does not hold for, and questions that do not fit their law.
DesignAnswer find_design(const DesignQuestion& question);

}  // namespace tether
