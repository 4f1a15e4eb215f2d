#include "netem/statistics/delay_statistics.hpp"

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <cassert>
#include <cmath>
#include <limits>

namespace tether {
void DelayStatistics::add(Duration delay) {
  const std::int64_t ns = std::max<std::int64_t>(0, delay.count());
  Bin& bin = bins_.of(ns);
  bin.low_ns = bin.count == 0 ? ns : std::min(bin.low_ns, ns);
  bin.high_ns = bin.count == 0 ? ns : std::max(bin.high_ns, ns);
  bin.sum_ns += static_cast<double>(ns);
  ++bin.count;
  shortest_ns_ = count_ == 0 ? ns : std::min(shortest_ns_, ns);
  longest_ns_ = std::max(longest_ns_, ns);
  ++count_;
  sum_ns_ += static_cast<double>(ns);
  if (count_ > kPilot) {
    indicate(ns);
    return;
  }
  pilot_.push_back(ns);
  if (count_ == kPilot) choose_thresholds();
}

void DelayStatistics::choose_thresholds() {
  std::vector<std::int64_t> sorted = pilot_;
  std::sort(sorted.begin(), sorted.end());
  for (std::size_t i = 0; i < kQuantiles.size(); ++i) {
    indicators_[i].threshold_ns =
        sorted[static_cast<std::size_t>(std::ceil(kQuantiles[i] * static_cast<double>(kPilot))) -
               1];
  }
  for (std::int64_t ns : pilot_) indicate(ns);
  pilot_ = {};
}

void DelayStatistics::indicate(std::int64_t delay_ns) {
  for (Indicator& indicator : indicators_) {
    const std::int64_t below = delay_ns <= indicator.threshold_ns ? 1 : 0;
    indicator.below += below;
    indicator.batches.add({below});
  }
}

double DelayStatistics::mean_s() const {
  return count_ == 0 ? std::numeric_limits<double>::quiet_NaN()
                     : sum_ns_ * 1e-9 / static_cast<double>(count_);
}

Estimate DelayStatistics::quantile(double q, double confidence, double vif) const {
  assert(q > 0.0 && q < 1.0 && vif > 0.0);
  if (count_ == 0) return {};
  const auto n = static_cast<double>(count_);
  const double effective = n / vif;
  const auto rank = [&](double share) {
    return std::clamp<std::int64_t>(static_cast<std::int64_t>(std::ceil(share * n)), 1, count_);
  };
  const Bin& middle = bins_.of_rank(rank(q));
  Estimate e;
  e.value = middle.sum_ns / static_cast<double>(middle.count) * 1e-9;
  e.low = 0.0;
  e.effective_samples = effective;
  if (effective < 1.0) return e;

  // The number of samples below the quantile is binomial; Boost rounds its quantiles outwards.
  const double tail = 0.5 * (1.0 - confidence);
  const boost::math::binomial below(std::floor(effective), q);
  const double low_rank = boost::math::quantile(below, tail);
  const double high_rank = boost::math::quantile(boost::math::complement(below, tail)) + 1.0;
  if (low_rank >= 1.0) {
    const double r = std::max(1.0, std::floor(low_rank * vif));
    e.low = static_cast<double>(bins_.of_rank(rank(r / n)).low_ns) * 1e-9;
  }
  if (high_rank * vif <= n) {
    e.high = static_cast<double>(bins_.of_rank(rank(high_rank * vif / n)).high_ns) * 1e-9;
  }
  return e;
}

double DelayStatistics::estimated_vif(std::size_t index) const {
  const Indicator& indicator = indicators_[index];
  const double p =
      count_ == 0 ? 0.0 : static_cast<double>(indicator.below) / static_cast<double>(count_);
  if (count_ < kPilot || !(p > 0.0 && p < 1.0)) return 1.0;
  return std::max(1.0, indicator.batches.asymptotic_variance({1.0}) / (p * (1.0 - p)));
}

bool DelayStatistics::vif_is_reliable(std::size_t index) const {
  const BatchMeans<1>& batches = indicators_[index].batches;
  return count_ >= kPilot && batches.batch_correlation({1.0}) <
                                 2.33 / std::sqrt(static_cast<double>(batches.batches()));
}

}  // namespace tether
