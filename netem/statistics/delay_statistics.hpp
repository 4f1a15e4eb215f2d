#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/base/time.hpp"
#include "netem/link/delay_bins.hpp"
#include "netem/statistics/batch_means.hpp"
#include "netem/statistics/estimate.hpp"

namespace tether {

/// Quantiles of delays with confidence intervals that assume nothing about the delays' law.
///
/// The interval of the quantile q is a pair of order statistics whose ranks are the binomial
/// distribution's (David & Nagaraja, Order Statistics, section 7.1) for the number of *effective*
/// samples; where even the largest delay is no upper bound at that level, there is none. The
/// effective number of samples is count/VIF, with the VIF of the indicator "delay <= quantile":
/// given by a model, or estimated by batch means (see BatchMeans) at the quantiles of the first
/// kPilot delays.
///
/// Memory is bounded: delays are kept in bins 1/256 of their value wide, with the smallest, the
/// largest and the mean of each bin. A constant delay is reported exactly; intervals are widened to
/// the ends of their bins, so they stay valid.
class DelayStatistics {
 public:
  static constexpr std::array<double, 3> kQuantiles{0.50, 0.90, 0.99};
  static constexpr std::int64_t kPilot = 1024;

  /// The next received packet's delay, in the order of sending. Negative ones count as zero.
  void add(Duration delay);

  std::int64_t count() const { return count_; }
  /// s; NaN without delays.
  double mean_s() const;
  /// s; 0 without delays.
  double shortest_s() const { return static_cast<double>(shortest_ns_) * 1e-9; }
  double longest_s() const { return static_cast<double>(longest_ns_) * 1e-9; }

  /// The quantile q, 0 < q < 1, in seconds.
  Estimate quantile(double q, double confidence, double vif) const;

  /// Variance inflation of kQuantiles[index], estimated from the delays themselves; at least 1. 1
  /// below kPilot delays, and if the delays are constant.
  double estimated_vif(std::size_t index) const;
  /// Whether there are enough delays, against their correlation time, to estimate it.
  bool vif_is_reliable(std::size_t index) const;

 private:
  struct Bin {
    std::int64_t count = 0;
    std::int64_t low_ns = 0, high_ns = 0;
    double sum_ns = 0.0;
  };
  struct Indicator {
    std::int64_t threshold_ns = 0;
    std::int64_t below = 0;  // delays <= threshold
    BatchMeans<1> batches;
  };
  void choose_thresholds();
  void indicate(std::int64_t delay_ns);

  DelayBins<Bin, 9> bins_;
  std::int64_t count_ = 0;
  double sum_ns_ = 0.0;
  std::int64_t shortest_ns_ = 0, longest_ns_ = 0;
  std::vector<std::int64_t> pilot_;
  std::array<Indicator, kQuantiles.size()> indicators_;
};

}  // namespace tether
