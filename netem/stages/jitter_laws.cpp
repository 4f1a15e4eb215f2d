#include "netem/stages/jitter_laws.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/distributions/gamma.hpp>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "netem/stages/delay_law.hpp"

namespace tether {
namespace {

// long double inside Boost.Math would cost five times as much for digits that are not used.
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

std::vector<double> uniform(const JitterSettings&, double m, double s) {
  return tabulated(
      [=](double z) { return m + s * std::numbers::sqrt3 * std::erf(z / std::numbers::sqrt2); });
}

std::vector<double> pareto(const JitterSettings& config, double m, double s) {
  const double a = config.shape;
  const double scale = s * (a - 1.0) * std::sqrt((a - 2.0) / a);
  return tabulated([=](double z) { return m + scale * pareto_at(a, z); });
}

std::vector<double> paretonormal(const JitterSettings& config, double m, double s) {
  const auto mix = [a = config.shape](double z) { return 0.25 * z + pareto_at(a, z); };
  const double scale = s / standard_deviation(mix);
  return tabulated([=](double z) { return m + scale * mix(z); });
}

std::vector<double> gamma(const JitterSettings&, double m, double s) {
  const boost::math::gamma_distribution<double, Fast> law(m * m / (s * s), s * s / m);
  return tabulated([&law](double z) { return gamma_at(law, z); });
}

std::string refuse_gamma(const JitterSettings& jitter) {
  if (jitter.mean_ms >= 0.1 * jitter.sd_ms && jitter.mean_ms <= 1e3 * jitter.sd_ms) return "";
  return fmt::format(
      "{{0}}law = \"gamma\" needs {{0}}mean_ms in [sd_ms/10, 1000 sd_ms]; they are {} and {}",
      jitter.mean_ms, jitter.sd_ms);
}

/// exp(μ + σ z) with mean m and standard deviation s.
std::vector<double> lognormal(const JitterSettings&, double m, double s) {
  const double variance = std::log1p(s * s / (m * m));
  return tabulated([mu = std::log(m) - 0.5 * variance, sigma = std::sqrt(variance)](double z) {
    return std::exp(mu + sigma * z);
  });
}

std::string refuse_lognormal(const JitterSettings& jitter) {
  if (jitter.mean_ms >= 0.1 * jitter.sd_ms && jitter.mean_ms <= 1e3 * jitter.sd_ms) return "";
  return fmt::format(
      "{{0}}law = \"lognormal\" needs {{0}}mean_ms in [sd_ms/10, 1000 sd_ms]; they are {} and {}",
      jitter.mean_ms, jitter.sd_ms);
}

std::string refuse_table(const JitterSettings& jitter) {
  const auto& table = jitter.table_ms;
  if (table.empty() == jitter.file.empty()) {
    return "{0}law = \"table\" needs one of {0}table_ms and {0}file";
  }
  if (table.size() == 1 || !std::is_sorted(table.begin(), table.end())) {
    return "{0}table_ms must have two or more entries, none below the one before";
  }
  return "";
}

// ----------------------------------------------------------------------------------------- tc

// iproute2's tables: value = T + J·entry/8192, 4096 entries, drawn uniformly. Pareto: entry/8192 =
// (4/3)(Y − 1.5), P[Y > y] = y^−3, cut at 4; measured on Debian 12's pareto.dist: mean −0.0335,
// standard deviation 0.820 (uncut 1.1547). Paretonormal: 0.25 Z + 0.75 of that; −0.0253, 0.834
// (uncut 1.05177).
constexpr double kParetoSd = 1.1547005383792515;       // 2/√3
constexpr double kParetonormalSd = 1.051771923566881;  // standard deviation of 0.25 Z + (Y − 1.5)

TcJitter tc_uniform(const JitterSettings& jitter) {
  return {.jitter_ms = std::numbers::sqrt3 * jitter.sd_ms};
}

TcJitter tc_normal(const JitterSettings& jitter) {
  return {.jitter_ms = jitter.sd_ms,
          .distribution = "normal",
          .note = fmt::format("normal: tc's table ends at T {:+.3g} ms and {:+.3g} ms",
                              -4.0 * jitter.sd_ms, 3.523 * jitter.sd_ms)};
}

TcJitter tc_pareto(const JitterSettings& jitter) {
  const bool mixed = jitter.law == "paretonormal";
  if (jitter.shape != 3.0) return {.missing = "tc's table has the tail index 3"};
  TcJitter tc;
  tc.jitter_ms = jitter.sd_ms / (mixed ? kParetonormalSd : kParetoSd);
  tc.distribution = jitter.law;
  tc.note = fmt::format(
      "{}: J = sd/{}; tc's table ends at T {:+.3g} ms and {:+.3g} ms (the law itself has no upper "
      "end), which takes {:.3g} ms from the mean and leaves a standard deviation of {:.3g} ms",
      tc.distribution, mixed ? "1.0518" : "1.1547", (mixed ? -1.502 : -0.667) * tc.jitter_ms,
      (mixed ? 3.881 : 4.0) * tc.jitter_ms, (mixed ? 0.0253 : 0.0335) * tc.jitter_ms,
      (mixed ? 0.834 : 0.820) * tc.jitter_ms);
  return tc;
}

TcJitter tc_gamma(const JitterSettings&) { return {.missing = "tc has no table of gamma laws"}; }

TcJitter tc_lognormal(const JitterSettings&) {
  return {.missing = "tc has no table of lognormal laws"};
}

TcJitter tc_table(const JitterSettings&) {
  return {.missing =
              "tc reads tables of another kind (maketable of iproute2's sources makes them)"};
}

}  // namespace

bool JitterLaw::uses(const std::string& key) const {
  return std::find(keys.begin(), keys.end(), key) != keys.end();
}

const std::vector<JitterLaw>& jitter_laws() {
  using Form = JitterLaw::Form;
  static const std::vector<std::string> kSpread{"mean_ms", "sd_ms", "correlation"};
  static const std::vector<std::string> kTail{"mean_ms", "sd_ms", "shape", "correlation"};
  static const std::vector<std::string> kTable{"table_ms", "file", "correlation"};
  static const std::vector<JitterLaw> laws{
      {"none", {}},
      {"constant", {"mean_ms"}},
      {"uniform", kSpread, Form::scores, uniform, nullptr, tc_uniform},
      {"normal", kSpread, Form::normal, nullptr, nullptr, tc_normal},
      {"pareto", kTail, Form::scores, pareto, nullptr, tc_pareto},
      {"paretonormal", kTail, Form::scores, paretonormal, nullptr, tc_pareto},
      {"gamma", kSpread, Form::scores, gamma, refuse_gamma, tc_gamma},
      {"lognormal", kSpread, Form::scores, lognormal, refuse_lognormal, tc_lognormal},
      {"table", kTable, Form::quantiles, nullptr, refuse_table, tc_table}};
  return laws;
}

const JitterLaw& jitter_law(const JitterSettings& settings) {
  for (const JitterLaw& row : jitter_laws()) {
    if (row.name == settings.law) return row;
  }
  throw std::logic_error("no such jitter law: " + settings.law);
}

}  // namespace tether
