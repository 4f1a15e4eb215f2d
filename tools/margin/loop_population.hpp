#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "common/scenario/scenario.hpp"

namespace tether {

/// Whole loops on a straight: controller, relay and plant.
struct PopulationTrial {
  std::size_t loops = 150;
  std::size_t periods = 100;  ///< periods that count; the loops settle for 120 before them
  std::uint64_t seed = 1;
};

struct PopulationGrowth {
  double log_radius = 0.0;  ///< log of the growth of the mean square per period
  double largest_m = 0.0;   ///< deviation of any loop; the theory is about small ones
  double speed_off = 0.0;   ///< largest share that a speed was off by; the theory's is constant
};

/// Why a scenario's runs cannot be compared with the theory; "" if they can: its path is a straight
/// with one speed.
std::string why_no_trial(const Scenario& scenario);

/// Like simulated_radius() of margin/theory/linear_trial.hpp, but of the loops that ship, without
/// noise. When losses begin, errors along the straight have settled to less than 0.1 um. Errors
/// across stay far below a millimetre, so that limits, which are not in the theory, play no part,
/// and far above rounding. Every few periods loops are resampled in proportion to their squares. A
/// loop is copied by a second run that meets the same luck until now, and another from now on:
/// models of channels are Markov chains, so any of the same state goes on like it. Without losses
/// all loops are equal: then there is one.
///
/// Each link loses `more_loss` of its packets, independently, beside what it loses. The scenario
/// has no margin_obstacles() and no why_no_trial().
PopulationGrowth whole_loop_growth(const Scenario& scenario, double more_loss,
                                   const PopulationTrial& trial);

}  // namespace tether
