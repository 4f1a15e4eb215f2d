#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "tools/experiment/statistics/statistics.hpp"

namespace tether {

/// The result of one run. Runs of several arms (settings) with one seed get the same random numbers
/// where they make the same draws, and are compared with each other.
struct SeededValue {
  std::uint64_t seed = 0;
  double value = 0.0;
};

/// Fewer pairs separate nothing: even if all differences had one sign, a sign test could not reject
/// at 5 % (2·0.5^5 = 0.0625). This also holds for runs without any randomness, whose differences
/// are all the same.
inline constexpr std::size_t kLeastPairs = 6;

/// Statistics of first − second, over the seeds that both have.
struct PairedDifference {
  Summary difference;
  std::size_t left_out = 0;  ///< seeds that only one has, or where a value is not finite
  bool separated = false;    ///< at least kLeastPairs, and the mean's interval excludes 0
};

/// One comparison, decided upon before looking at the data; several at once need ties_of_best().
/// Each seed is at most once in an arm, here and below.
PairedDifference paired_difference(const std::vector<SeededValue>& first,
                                   const std::vector<SeededValue>& second, double confidence,
                                   std::uint64_t seed);

/// Statistics of mean(first)/mean(second), over the seeds that both have.
struct MeanRatio {
  double ratio = std::numeric_limits<double>::quiet_NaN();
  Interval interval;  ///< BCa, seeds resampled in pairs; none for fewer than two
  Summary first, second;
  std::size_t left_out = 0;  ///< the same as above
};
MeanRatio mean_ratio(const std::vector<SeededValue>& first, const std::vector<SeededValue>& second,
                     double confidence, std::uint64_t seed);

/// Which of several arms has the smallest mean, and which could have it as well.
struct BestArm {
  std::optional<std::size_t> best;  ///< none if no seed has a finite value in all arms
  std::vector<bool> tied;           ///< a flag an arm: cannot be separated from the best; with it
  std::vector<double> means;        ///< over the common seeds
  /// Simultaneous intervals of each arm's mean − the best's. None for the best, below kLeastPairs,
  /// and where the resampled spread vanishes too often to say.
  std::vector<Interval> differences;
  std::size_t n = 0;         ///< common seeds
  std::size_t left_out = 0;  ///< seeds that are not in all arms, or not finite in one
};

/// Compares all arms that have any finite value, over the seeds that all of these have. The other
/// arms take no part (never tied, mean NaN).
///
/// Method: the paired differences of all pairs of arms, not only of those with the best, have
/// simultaneous intervals by the bootstrap of seeds. Each pair's |t|, studentised by its sample, is
/// replaced by its rank among the resamples of that pair. The largest rank over the pairs gives one
/// level for all, and each pair's own quantile at that level its interval (balanced simultaneous
/// sets: Beran, JASA 83(403), 1988; the maximum over all pairs as in Romano and Wolf, Econometrica
/// 73(4), 2005). Ranks keep a pair that one rare lost run makes uncertain from widening the
/// intervals of the others, which the largest |t| itself does. An arm is separated if its interval
/// to the best excludes 0. As all pairs hold at once with `confidence`, it does no harm that the
/// best was chosen by the same data: the probability of separating any arm that is as good as the
/// best one is at most 1 − confidence, asymptotically. Holm's steps over the comparisons with the
/// best are not used because they ignore that choice.
///
/// Separating means "worse": an arm that is tied was not shown to be equally good.
BestArm ties_of_best(const std::vector<std::vector<SeededValue>>& arms, double confidence,
                     std::uint64_t seed);

}  // namespace tether
