#pragma once

#include <vector>

namespace tether {

/// netem/models/markov_chain.hpp: as many states as `prr` has entries.
struct ChainConfig {
  std::vector<double> prr;
  std::vector<double> delay_ms;  ///< empty: no delay in any state
  /// One of the two matrices: rates from row to column in 1/s (the diagonal is not used and must be
  /// 0 or minus the sum of the others) …
  std::vector<std::vector<double>> rates_per_s;
  /// … or probabilities of a step; each row sums to 1.
  std::vector<std::vector<double>> probabilities;
  double step_s = 0.0;  ///< probabilities: time between steps; 0 = a step per packet

  double delay_in(std::size_t state) const { return delay_ms.empty() ? 0.0 : delay_ms[state]; }

  bool operator==(const ChainConfig&) const = default;
};

}  // namespace tether
