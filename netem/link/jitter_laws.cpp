#include "netem/link/jitter_laws.hpp"

#include <algorithm>
#include <boost/math/distributions/gamma.hpp>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "netem/link/delay_law.hpp"

namespace tether {
namespace {

using Law = JitterConfig::Law;

// long double inside Boost.Math would cost five times as much for digits that nobody sees.
using Fast = boost::math::policies::policy<boost::math::policies::promote_double<false>>;

constexpr std::size_t kScoreSteps = 16384;

double upper_tail(double z) { return 0.5 * std::erfc(z / std::numbers::sqrt2); }

/// Quantile of the gamma law at Φ(z), from the nearer end, where the probability has all digits.
double gamma_at(const boost::math::gamma_distribution<double, Fast>& gamma, double z) {
  return z < 0.0 ? quantile(gamma, upper_tail(-z))
                 : quantile(boost::math::complement(gamma, upper_tail(z)));
}

/// Y − E Y of a Pareto law from 1.
double pareto_at(double shape, double z) {
  return std::pow(upper_tail(z), -1.0 / shape) - shape / (shape - 1.0);
}

/// Standard deviation of f(z) for a standard normal z, of mean zero: Simpson's rule.
template <class Function>
double standard_deviation(Function f) {
  constexpr int kSteps = 4000;
  constexpr double kStep = 2.0 * kMaxScore / kSteps;
  double sum = 0.0;
  for (int i = 0; i <= kSteps; ++i) {
    const double z = -kMaxScore + kStep * i;
    const double weight = i == 0 || i == kSteps ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
    sum += weight * f(z) * f(z) * std::exp(-0.5 * z * z);
  }
  return std::sqrt(sum * kStep / 3.0 * std::numbers::inv_sqrtpi / std::numbers::sqrt2);
}

template <class Function>
std::vector<double> tabulated(Function f) {
  std::vector<double> table(kScoreSteps + 1);
  for (std::size_t i = 0; i <= kScoreSteps; ++i) {
    table[i] = f(kMaxScore * (2.0 * static_cast<double>(i) / kScoreSteps - 1.0));
  }
  return table;
}

std::vector<double> uniform(const JitterConfig&, double m, double s) {
  return tabulated(
      [=](double z) { return m + s * std::numbers::sqrt3 * std::erf(z / std::numbers::sqrt2); });
}

std::vector<double> pareto(const JitterConfig& config, double m, double s) {
  const double a = config.shape;
  const double scale = s * (a - 1.0) * std::sqrt((a - 2.0) / a);
  return tabulated([=](double z) { return m + scale * pareto_at(a, z); });
}

std::vector<double> paretonormal(const JitterConfig& config, double m, double s) {
  const auto mix = [a = config.shape](double z) { return 0.25 * z + pareto_at(a, z); };
  const double scale = s / standard_deviation(mix);
  return tabulated([=](double z) { return m + scale * mix(z); });
}

std::vector<double> gamma(const JitterConfig&, double m, double s) {
  const boost::math::gamma_distribution<double, Fast> law(m * m / (s * s), s * s / m);
  return tabulated([&law](double z) { return gamma_at(law, z); });
}

}  // namespace

bool JitterLaw::uses(const std::string& key) const {
  return std::find(keys.begin(), keys.end(), key) != keys.end();
}

const std::vector<JitterLaw>& jitter_laws() {
  static const std::vector<std::string> kSpread{"mean_ms", "sd_ms", "correlation"};
  static const std::vector<std::string> kTail{"mean_ms", "sd_ms", "shape", "correlation"};
  static const std::vector<JitterLaw> laws{
      {Law::none, "none", {}},
      {Law::constant, "constant", {"mean_ms"}},
      {Law::uniform, "uniform", kSpread, uniform},
      {Law::normal, "normal", kSpread},
      {Law::pareto, "pareto", kTail, pareto},
      {Law::paretonormal, "paretonormal", kTail, paretonormal},
      {Law::gamma, "gamma", kSpread, gamma},
      {Law::table, "table", {"table_ms", "file", "correlation"}}};
  return laws;
}

const JitterLaw& jitter_law(JitterConfig::Law law) {
  for (const JitterLaw& row : jitter_laws()) {
    if (row.law == law) return row;
  }
  throw std::logic_error("no such jitter law");
}

}  // namespace tether
