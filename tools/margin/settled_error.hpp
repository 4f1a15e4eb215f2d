#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "margin/loop/survival.hpp"

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

}  // namespace tether
