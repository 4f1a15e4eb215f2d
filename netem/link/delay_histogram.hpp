#pragma once

#include <cstdint>

#include "common/base/time.hpp"
#include "netem/link/delay_bins.hpp"

namespace tether {

/// Quantiles of delays in bounded memory. Bins are 1/64 of their value wide, and each keeps the
/// mean of what fell into it: a constant delay is reported exactly, others within 1.6 %.
class DelayHistogram {
 public:
  /// Negative delays count as zero.
  void add(Duration delay);

  /// The smallest bin's mean below or at which a share `q` (0..1) of the delays lies; zero if there
  /// are none.
  Duration quantile(double q) const;
  /// Zero if there are none.
  Duration mean() const;
  Duration max() const { return max_; }
  std::int64_t count() const { return count_; }

 private:
  struct Bin {
    std::int64_t count = 0;
    std::int64_t sum_ns = 0;
  };
  DelayBins<Bin, 7> bins_;
  std::int64_t count_ = 0;
  double sum_ns_ = 0.0;
  Duration max_{0};
};

}  // namespace tether
