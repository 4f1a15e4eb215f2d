#include "tools/experiment/statistics/survival.hpp"

#include <cassert>
#include <cmath>

#include "netem/statistics/estimate.hpp"

namespace tether {

Share share_of(std::size_t count, std::size_t n, double confidence) {
  assert(count <= n);
  Share share{count, n, std::numeric_limits<double>::quiet_NaN(), {}};
  if (n == 0) return share;
  const Estimate estimate =
      proportion_interval(static_cast<double>(count), static_cast<double>(n), confidence);
  share.value = estimate.value;
  share.interval = {estimate.low, estimate.high};
  return share;
}

Survival survival_of(const std::vector<double>& values, const std::vector<double>& lost,
                     double confidence, std::uint64_t seed) {
  assert(values.size() == lost.size());
  std::size_t known = 0, count = 0;
  std::vector<double> survivors;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (std::isnan(lost[i])) continue;
    ++known;
    if (lost[i] > 0.5) {
      ++count;
    } else {
      survivors.push_back(values[i]);
    }
  }
  return {share_of(count, known, confidence), summarize(survivors, confidence, seed)};
}

Returns returns_of(const std::vector<double>& returns, const std::vector<double>& away,
                   double confidence, std::uint64_t seed) {
  assert(returns.size() == away.size());
  Returns result;
  std::vector<double> times;
  for (std::size_t i = 0; i < returns.size(); ++i) {
    if (returns[i] > 0.0) times.push_back(returns[i]);
    if (away[i] > 0.0) ++result.not_back;
  }
  result.times = summarize(times, confidence, seed);
  return result;
}

}  // namespace tether
