#include "tools/experiment/statistics/statistics.hpp"

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/normal.hpp>
#include <cassert>
#include <cmath>
#include <numeric>

#include "common/base/random.hpp"
#include "tools/experiment/statistics/random_index.hpp"

namespace tether {
namespace {

namespace math = boost::math;

std::vector<double> finite_ascending(const std::vector<double>& values) {
  std::vector<double> ascending;
  std::copy_if(values.begin(), values.end(), std::back_inserter(ascending),
               [](double value) { return std::isfinite(value); });
  std::sort(ascending.begin(), ascending.end());
  return ascending;
}

// Σ (x − mean)^power
double moment_sum(const std::vector<double>& values, double mean, int power) {
  double sum = 0.0;
  for (const double value : values) sum += std::pow(value - mean, power);
  return sum;
}

std::vector<double> resampled_means(const std::vector<double>& values, std::uint64_t seed) {
  RandomEngine random = random_stream(seed, "bootstrap/mean");
  std::vector<double> means(kResamples);
  for (double& mean : means) {
    double sum = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i)
      sum += values[random_index(random, values.size())];
    mean = sum / static_cast<double>(values.size());
  }
  std::sort(means.begin(), means.end());
  return means;
}

// The quantile of the resampled means that is the interval's end for the normal quantile `z`.
double bca_level(double bias, double acceleration, double z) {
  const double shifted = bias + z;
  const double divisor = 1.0 - acceleration * shifted;
  if (divisor <= 0.0) return shifted > 0.0 ? 1.0 : 0.0;
  return math::cdf(math::normal(), bias + shifted / divisor);
}

// z₀: the normal quantile of the share of resampled means below the mean, ties counted half.
double bias_correction(const std::vector<double>& means, double mean) {
  const auto below = std::lower_bound(means.begin(), means.end(), mean) - means.begin();
  const auto not_above = std::upper_bound(means.begin(), means.end(), mean) - means.begin();
  const auto n = static_cast<double>(means.size());
  const double share = 0.5 * static_cast<double>(below + not_above) / n;
  return math::quantile(math::normal(), std::clamp(share, 0.5 / n, 1.0 - 0.5 / n));
}

Interval bca_of_mean(const std::vector<double>& ascending, double confidence, std::uint64_t seed) {
  assert(confidence > 0.0 && confidence < 1.0);
  if (ascending.size() < 2) return {};
  if (ascending.front() == ascending.back()) return {ascending.front(), ascending.front()};
  const double mean = mean_of(ascending);
  const std::vector<double> means = resampled_means(ascending, seed);
  const double bias = bias_correction(means, mean);
  // The acceleration from the jackknife, which has this closed form for a mean.
  const double acceleration =
      moment_sum(ascending, mean, 3) / (6.0 * std::pow(moment_sum(ascending, mean, 2), 1.5));
  const double z = math::quantile(math::normal(), 0.5 * (1.0 + confidence));
  return {quantile(means, bca_level(bias, acceleration, -z)),
          quantile(means, bca_level(bias, acceleration, z))};
}

Interval order_interval(const std::vector<double>& ascending, double confidence) {
  assert(confidence > 0.0 && confidence < 1.0);
  const double tail = 0.5 * (1.0 - confidence);
  const std::size_t n = ascending.size();
  const math::binomial below(static_cast<double>(n), 0.5);
  // Number of values that can be cut off at either end: P[at most cut − 1 below the median] <=
  // tail.
  std::size_t cut = 0;
  while (2 * cut < n && math::cdf(below, static_cast<double>(cut)) <= tail) ++cut;
  if (cut == 0) return {};
  return {ascending[cut - 1], ascending[n - cut]};
}

}  // namespace

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double half_width(const Interval& interval) { return 0.5 * (interval.high - interval.low); }

bool contains(const Interval& interval, double value) {
  return interval.low <= value && value <= interval.high;
}

double quantile(const std::vector<double>& ascending, double p) {
  assert(!ascending.empty() && p >= 0.0 && p <= 1.0);
  const double rank = p * static_cast<double>(ascending.size() - 1);
  const auto below = static_cast<std::size_t>(rank);
  const double low = ascending[below];
  const double high = ascending[std::min(below + 1, ascending.size() - 1)];
  return low + (rank - static_cast<double>(below)) * (high - low);
}

Interval mean_interval(const std::vector<double>& values, double confidence, std::uint64_t seed) {
  return bca_of_mean(finite_ascending(values), confidence, seed);
}

Interval bca_interval(double measured, std::vector<double> resampled,
                      const std::vector<double>& without_one, double confidence) {
  if (without_one.size() < 2 || resampled.empty()) return {};
  std::sort(resampled.begin(), resampled.end());
  if (resampled.front() == resampled.back()) return {resampled.front(), resampled.front()};
  const double centre = mean_of(without_one);
  const double squares = moment_sum(without_one, centre, 2);
  const double acceleration =
      squares > 0.0 ? -moment_sum(without_one, centre, 3) / (6.0 * std::pow(squares, 1.5)) : 0.0;
  const double bias = bias_correction(resampled, measured);
  const double z = math::quantile(math::normal(), 0.5 * (1.0 + confidence));
  return {quantile(resampled, bca_level(bias, acceleration, -z)),
          quantile(resampled, bca_level(bias, acceleration, z))};
}

Interval median_interval(const std::vector<double>& values, double confidence) {
  return order_interval(finite_ascending(values), confidence);
}

Summary summarize(const std::vector<double>& values, double confidence, std::uint64_t seed) {
  const std::vector<double> ascending = finite_ascending(values);
  Summary s;
  s.n = ascending.size();
  s.left_out = values.size() - s.n;
  if (s.n == 0) return s;
  s.min = ascending.front();
  s.max = ascending.back();
  s.mean = s.min == s.max ? s.min : mean_of(ascending);
  if (s.n > 1) {
    s.sd = s.min == s.max
               ? 0.0
               : std::sqrt(moment_sum(ascending, s.mean, 2) / static_cast<double>(s.n - 1));
  }
  s.median = quantile(ascending, 0.5);
  s.q05 = quantile(ascending, 0.05);
  s.q25 = quantile(ascending, 0.25);
  s.q75 = quantile(ascending, 0.75);
  s.q95 = quantile(ascending, 0.95);
  s.mean_interval = bca_of_mean(ascending, confidence, seed);
  s.median_interval = order_interval(ascending, confidence);
  return s;
}

}  // namespace tether
