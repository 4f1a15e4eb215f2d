#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/experiment/statistics/statistics.hpp"

namespace tether {

/// A share of runs, with the interval of Clopper and Pearson (Biometrika 26, 1934): exact in that
/// it holds the true share at least as often as it says, whatever that is, also for none and all.
/// Without runs the share and the interval are NaN.
struct Share {
  std::size_t count = 0;
  std::size_t n = 0;
  double value = std::numeric_limits<double>::quiet_NaN();
  Interval interval;
};
Share share_of(std::size_t count, std::size_t n, double confidence);

/// A result with two humps, as two numbers: which share of vehicles was lost, and how the others
/// did.
///
/// One mean of both says little, and its interval too little: if no lost vehicle is among the runs,
/// the interval does not know of any. Measured over 20000 sets of n = 30 runs of which 3.7 % are
/// lost (at 22 m, the others 1.9 ± 0.1 m), to ±0.3 %, how often 95 % intervals hold the truth:
///
///     BCa interval of the mean of all runs      67.1 %
///     interval of the share of lost ones        97.7 %
///     BCa interval of the survivors' mean       93.4 %
///
/// 32.5 % of the sets had no lost vehicle. The last is what BCa reaches with 29 normal values.
struct Survival {
  Share lost;
  /// The values of the vehicles that were not lost, summarized; what is left out are values that
  /// are not finite.
  Summary survivors;
};

/// `lost`: of the same runs, above 0.5 if the vehicle was lost, NaN if the run failed or nothing is
/// known of it. Runs of which nothing is known are left out.
Survival survival_of(const std::vector<double>& values, const std::vector<double>& lost,
                     double confidence, std::uint64_t seed);

/// The time to return. A run's is how long its longest excursion lasted of those that were over.
struct Returns {
  Summary times;             ///< times of the runs that have one
  std::size_t not_back = 0;  ///< runs that ended while the vehicle was away: cut off, in no mean
};
/// `returns`: 0 if there was none; `away`: how long the vehicle had been away at the end.
Returns returns_of(const std::vector<double>& returns, const std::vector<double>& away,
                   double confidence, std::uint64_t seed);

}  // namespace tether
