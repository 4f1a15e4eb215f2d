#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tether {

/// Quantity that a search minimises.
enum class Aim : std::uint8_t {
  error,     ///< the mean over the conditions of the mean of the metric, lost vehicles included
  survival,  ///< the number of lost vehicles; of equals the error of the others
};

/// Outcome of a run of a candidate. A run that failed has NaN as metric, and is lost.
struct TunedRun {
  double metric = 0.0;
  bool lost = false;
};

/// How runs are summed up.
struct WorthRule {
  double most = 0.0;         ///< a run's metric counts as no more; infinity: as it is
  bool is_geometric = true;  ///< the mean over the conditions; else arithmetic
};

/// Worth of a law's runs with one set of values.
struct Worth {
  std::vector<double> means;    ///< means of the metric, by condition; all runs
  double error = 0.0;           ///< mean of `means`
  std::size_t lost = 0, n = 0;  ///< runs of all conditions
  std::vector<std::size_t> lost_by_condition;
  /// Like `error`, without the lost runs. A condition without survivors counts as WorthRule::most.
  double survivors_error = 0.0;

  /// Share of lost runs.
  double lost_share() const { return static_cast<double>(lost) / static_cast<double>(n); }
  /// To be small. Of Aim::survival `lost` + e/(1 + e), with e = survivors_error: as the second term
  /// is below 1, one lost vehicle more is worse than any error.
  double objective(Aim aim) const;
};

/// `runs`: of each condition, at least one.
Worth worth_of(const WorthRule& rule, const std::vector<std::vector<TunedRun>>& runs);

}  // namespace tether
