#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "common/scenario/scenario.hpp"
#include "netem/statistics/estimate.hpp"
#include "tools/margin/mean_square.hpp"

namespace tether {

/// How long a vehicle drives on the straight of StraightLoop until it is farther than
/// run.lost_beyond_m from the path's point of now.
struct FirstExcursion {
  double beyond_m = 0.0;
  Estimate mean_s;  ///< with its 95 % interval; without excursions the lower bound alone is finite
  std::size_t excursions = 0;
  double driven_s = 0.0;  ///< in all, without what vehicles need to settle
};

/// From rest a vehicle is behind its path at first; its time counts from here on.
inline constexpr double kSurvivalSettling_s = 20.0;

struct SurvivalTrial {
  std::size_t most_excursions = 200;
  std::size_t most_periods = 1'000'000;  ///< in all
  std::uint64_t seed = 1;
};

/// Simulated: the law with its limits, the kinematic plant with those of its wheels, the sensor's
/// white noise, the chain's losses and the constant delays. After an excursion another vehicle
/// begins. nullopt with plans, and where the sensor has errors that are not white. The scenario has
/// no margin_obstacles().
std::optional<FirstExcursion> first_excursion(const Scenario& scenario,
                                              const SurvivalTrial& trial = {});

/// The smallest PRR each way, with independent losses, at which errors vanish almost surely
/// (almost_sure_growth()). To about 0.005.
Critical almost_sure_prr(const Scenario& scenario);

}  // namespace tether
