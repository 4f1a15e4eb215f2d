#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "tools/experiment/statistics/statistics.hpp"

namespace tether {

/// The runs of one kind, and the probability, known without them, that a run is of this kind.
struct Stratum {
  double probability = 0.0;
  std::vector<double> values;
};

struct StratifiedMean {
  std::size_t n = 0;
  std::size_t left_out = 0;  ///< values that are not finite
  double mean = std::numeric_limits<double>::quiet_NaN();
  Interval interval;
};

/// Σ p_h · (mean of stratum h): the mean over all kinds of runs, by post-stratification (Little,
/// JASA 88(423), 1993). How many of the runs happened to be of each kind no longer matters, which
/// takes the variance between the kinds out: all of it that a kind has whose runs are all equal.
/// Unbiased, given that each kind with p_h > 0 has a run; else all is NaN. Probabilities sum to 1.
///
/// The interval is BCa's (bca_interval()), runs resampled within their kind; none where a kind with
/// p_h > 0 has only one run; by few runs of a kind it holds the mean less often, as mean_interval()
/// does by as many. `seed` as in statistics.hpp.
StratifiedMean stratified_mean(const std::vector<Stratum>& strata, double confidence,
                               std::uint64_t seed);

}  // namespace tether
