#include "netem/fit/delays.hpp"

#include <algorithm>
#include <boost/math/distributions/normal.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>

#include "netem/fit/delay_laws.hpp"

namespace tether {
namespace {

constexpr std::int64_t kFewestPairs = 50;

std::vector<double> known_delays(const DelayLog& log) {
  std::vector<double> delays;
  for (const auto& segment : log) {
    for (const double delay : segment) {
      if (!std::isnan(delay)) delays.push_back(delay);
    }
  }
  return delays;
}

/// The log with normal scores of ranks in place of delays; equal delays get one score.
DelayLog scores_of(const DelayLog& log, const std::vector<double>& sorted) {
  const auto n = static_cast<double>(sorted.size());
  DelayLog scores = log;
  for (auto& segment : scores) {
    for (double& x : segment) {
      if (std::isnan(x)) continue;
      const auto [low, high] = std::equal_range(sorted.begin(), sorted.end(), x);
      const double rank =
          0.5 * static_cast<double>((low - sorted.begin()) + (high - sorted.begin()));
      x = boost::math::quantile(boost::math::normal(),
                                std::clamp(rank / n, 0.5 / n, 1.0 - 0.5 / n));
    }
  }
  return scores;
}

struct Correlation {
  double value = 0.0;
  double pairs = 0.0;
};

/// Correlation of scores `lag` packets apart, where both packets arrived.
Correlation correlation_at(const DelayLog& scores, std::size_t lag) {
  double products = 0.0, squares = 0.0, pairs = 0.0;
  for (const auto& segment : scores) {
    for (std::size_t i = lag; i < segment.size(); ++i) {
      const double a = segment[i - lag], b = segment[i];
      if (std::isnan(a) || std::isnan(b)) continue;
      products += a * b;
      squares += 0.5 * (a * a + b * b);
      pairs += 1.0;
    }
  }
  return {squares > 0.0 ? products / squares : 0.0, pairs};
}

void correlate(const DelayLog& log, const std::vector<double>& sorted, DelayFit& fit) {
  const DelayLog scores = scores_of(log, sorted);
  const Correlation near = correlation_at(scores, 1);
  if (near.pairs < static_cast<double>(kFewestPairs)) return;
  const double c = near.value;
  const double error = std::sqrt((1.0 - c * c) / near.pairs);
  if (std::abs(c) < DelayFit::kSignificant / std::sqrt(near.pairs)) return;
  fit.correlation = std::clamp(c, -0.9999, 0.9999);
  fit.correlation_error = error;
  const Correlation far = correlation_at(scores, DelayFit::kFar);
  fit.far = far.value;
  fit.far_expected = std::pow(c, DelayFit::kFar);
  // Bartlett's, of an AR(1) sequence at lags beyond its memory; where one packet knows all of the
  // next, less is to be learned.
  fit.far_error = std::sqrt((1.0 + c * c) / (1.0 - c * c) / std::max(1.0, far.pairs));
}

double distance(const FittedLaw& law, const std::vector<double>& sorted) {
  const auto n = static_cast<double>(sorted.size());
  double most = 0.0;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const double f = law.cdf(sorted[i]), below = static_cast<double>(i) / n;
    most = std::max({most, f - below, below + 1.0 / n - f});
  }
  return most;
}

/// P[Kolmogorov's distance of n values > d], asymptotically.
double kolmogorov(double d, double n) {
  const double t = (std::sqrt(n) + 0.12 + 0.11 / std::sqrt(n)) * d;
  if (t < 0.3) return 1.0;
  double sum = 0.0;
  for (int k = 1; k <= 100; ++k) sum += (k % 2 == 1 ? 2.0 : -2.0) * std::exp(-2.0 * k * k * t * t);
  return std::clamp(sum, 0.0, 1.0);
}

FitParameter parameter(const char* name, double value, double error) {
  return {name, value, error, value - 1.96 * error, value + 1.96 * error, false};
}

DelayFit::Candidate candidate_of(const FittedLaw& law, const std::vector<double>& sorted,
                                 double effective) {
  DelayFit::Candidate c;
  c.law = law.name;
  c.sd_s = law.sd;
  c.shape = law.shape;
  const bool has_end = law.name != "normal" && law.name != "uniform";
  c.constant_s = has_end ? law.lower_end : law.mean;
  c.mean_s = has_end ? law.mean : 0.0;
  c.bic = law.free_parameters * std::log(effective) - 2.0 * effective * law.log_likelihood;
  c.distance = distance(law, sorted);
  c.p_value = kolmogorov(c.distance, effective);
  const double inflation = std::sqrt(static_cast<double>(sorted.size()) / effective) * 1e3;
  c.parameters.push_back(
      parameter("delay_ms", c.constant_s * 1e3, law.errors[has_end ? 0 : 1] * inflation));
  c.parameters.back().fixed = has_end && law.errors[0] == 0.0;
  if (has_end) {
    c.parameters.push_back(parameter("jitter.mean_ms", law.mean * 1e3, law.errors[1] * inflation));
  }
  c.parameters.push_back(parameter("jitter.sd_ms", law.sd * 1e3, law.errors[2] * inflation));
  if (law.name == "pareto") {
    c.parameters.push_back(parameter("jitter.shape", law.shape, law.errors[3] * inflation * 1e-3));
  }
  return c;
}

std::vector<double> quantiles(const std::vector<double>& sorted) {
  constexpr int kSteps = 100;
  std::vector<double> table;
  for (int i = 0; i <= kSteps; ++i) {
    const double position =
        static_cast<double>(i) / kSteps * static_cast<double>(sorted.size() - 1);
    const auto rank = std::min(static_cast<std::size_t>(position), sorted.size() - 2);
    const double share = position - static_cast<double>(rank);
    table.push_back(sorted[rank] + share * (sorted[rank + 1] - sorted[rank]));
  }
  return table;
}

}  // namespace

std::string DelayFit::law() const {
  if (candidates.empty()) return "none";
  return table_s.empty() ? candidates[best].law : "table";
}

DelayFit fit_delays(const DelayLog& log, double lowest_s) {
  constexpr double kSame_s = 1e-9;
  DelayFit fit;
  std::vector<double> sorted = known_delays(log);
  std::sort(sorted.begin(), sorted.end());
  fit.delays = std::ssize(sorted);
  fit.mean_s = sorted.empty() ? std::numeric_limits<double>::quiet_NaN()
                              : std::accumulate(sorted.begin(), sorted.end(), 0.0) /
                                    static_cast<double>(sorted.size());
  fit.effective = static_cast<double>(fit.delays);
  if (fit.delays < DelayFit::kFewest || sorted.back() - sorted.front() <= kSame_s) return fit;
  correlate(log, sorted, fit);
  const double c = std::max(0.0, fit.correlation);
  fit.effective = std::max(10.0, fit.effective * (1.0 - c) / (1.0 + c));
  for (const FittedLaw& law : fit_laws(sorted, lowest_s)) {
    fit.candidates.push_back(candidate_of(law, sorted, fit.effective));
    if (fit.candidates.back().bic < fit.candidates[fit.best].bic) {
      fit.best = fit.candidates.size() - 1;
    }
  }
  if (fit.candidates[fit.best].p_value < DelayFit::kFalseAlarm) fit.table_s = quantiles(sorted);
  return fit;
}

std::vector<double> delay_scores(const DelayLog& log) {
  std::vector<double> sorted = known_delays(log);
  std::ranges::sort(sorted);
  return known_delays(scores_of(log, sorted));
}

}  // namespace tether
