#include "tools/experiment/statistics/stratified.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "common/base/random.hpp"
#include "tools/experiment/statistics/random_index.hpp"
#include "tools/experiment/statistics/statistics.hpp"

namespace tether {
namespace {

double weighted_mean(const std::vector<Stratum>& strata) {
  double mean = 0.0;
  for (const Stratum& stratum : strata) mean += stratum.probability * mean_of(stratum.values);
  return mean;
}

/// Finite values in ascending order, without the kinds that no run can be of.
std::vector<Stratum> finite_strata(const std::vector<Stratum>& strata, std::size_t& left_out) {
  std::vector<Stratum> finite;
  double sum = 0.0;
  for (const Stratum& stratum : strata) {
    assert(stratum.probability >= 0.0);
    sum += stratum.probability;
    Stratum kept{stratum.probability, {}};
    std::copy_if(stratum.values.begin(), stratum.values.end(), std::back_inserter(kept.values),
                 [](double value) { return std::isfinite(value); });
    left_out += stratum.values.size() - kept.values.size();
    std::sort(kept.values.begin(), kept.values.end());
    if (stratum.probability > 0.0) finite.push_back(kept);
  }
  assert(std::abs(sum - 1.0) < 1e-9);
  return finite;
}

Interval interval_of(const std::vector<Stratum>& strata, double mean, double confidence,
                     std::uint64_t seed) {
  std::vector<double> without_one;
  for (const Stratum& stratum : strata) {
    const auto n = static_cast<double>(stratum.values.size());
    if (stratum.values.size() < 2) return {};
    const double own = mean_of(stratum.values);
    for (const double value : stratum.values) {
      without_one.push_back(mean + stratum.probability * (own - value) / (n - 1.0));
    }
  }
  RandomEngine random = random_stream(seed, "bootstrap/stratified");
  std::vector<double> resampled(kResamples);
  for (double& once : resampled) {
    once = 0.0;
    for (const Stratum& stratum : strata) {
      const auto& values = stratum.values;
      if (values.front() == values.back()) {  // exactly, whatever the rounding of a sum
        once += stratum.probability * values.front();
        continue;
      }
      double sum = 0.0;
      for (std::size_t i = 0; i < values.size(); ++i)
        sum += values[random_index(random, values.size())];
      once += stratum.probability * sum / static_cast<double>(values.size());
    }
  }
  return bca_interval(mean, resampled, without_one, confidence);
}

}  // namespace

StratifiedMean stratified_mean(const std::vector<Stratum>& strata, double confidence,
                               std::uint64_t seed) {
  StratifiedMean result;
  const std::vector<Stratum> finite = finite_strata(strata, result.left_out);
  for (const Stratum& stratum : finite) {
    if (stratum.values.empty()) return result;
  }
  for (const Stratum& stratum : finite) result.n += stratum.values.size();
  result.mean = weighted_mean(finite);
  result.interval = interval_of(finite, result.mean, confidence, seed);
  return result;
}

}  // namespace tether
