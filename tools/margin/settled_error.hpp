#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// Mean and 95 % interval of settled_epsilon_m, the mean distance to the reference from
/// run.settled_from_s on, of some runs of the whole loop on the scenario's own path.
struct SettledError {
  double mean_m = 0.0;
  double half_width_m = 0.0;
};

/// `seeds` ≥ 2, from 1 on; `jobs` threads. Throws std::runtime_error if a run fails.
SettledError settled_error(const Scenario& scenario, std::size_t seeds, std::size_t jobs);

}  // namespace tether
