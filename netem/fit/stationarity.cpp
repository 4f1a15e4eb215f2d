#include "netem/fit/stationarity.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <numbers>
#include <vector>

namespace tether {
namespace {

using std::numbers::pi;
using Spectrum = std::function<double(double)>;

const std::string kLoss = "the loss";
// Smaller p-values are not told apart, because the integral is not more exact. Of several
// drifts the first one is named.
constexpr double kLeastP = 1e-6;
// Share of S. Regular losses leave less, which is rounding and cannot be compared with.
constexpr double kLeastPower = 0.2;
constexpr int kLow = 8;  // beyond, 1/j² leaves nothing

/// Spectral density of an AR(1) process with correlation λ from packet to packet and variance 1.
double red(double lambda, double omega) {
  return (1.0 - lambda * lambda) / (1.0 - 2.0 * lambda * std::cos(omega) + lambda * lambda);
}

/// Spectral density of the losses of a Gilbert–Elliott channel.
Spectrum loss_spectrum(const GilbertElliott& m, double packets) {
  const double bad = m.p + m.r > 0.0 ? m.p / (m.p + m.r) : 0.0;
  const double loss = bad * m.one_minus_h + (1.0 - bad) * m.one_minus_k;
  const double difference = m.one_minus_h - m.one_minus_k;
  const double states = bad * (1.0 - bad) * difference * difference;
  const double tosses = loss * (1.0 - loss) - states;
  const double lambda = std::min(1.0 - m.p - m.r, 1.0 - Stationarity::kFewestTimes / packets);
  return [=](double omega) { return tosses + states * red(lambda, omega); };
}

/// Σ x_t z^(t + ½) for the z of each frequency; what is 0 costs nothing.
std::vector<std::complex<double>> sums_at(const std::vector<double>& x, double base_rad,
                                          std::size_t count) {
  std::vector<std::complex<double>> sums(count);
  for (std::size_t t = 0; t < x.size(); ++t) {
    if (x[t] == 0.0) continue;
    const std::complex<double> turn = std::polar(1.0, base_rad * (static_cast<double>(t) + 0.5));
    std::complex<double> power = turn * x[t];
    for (auto& sum : sums) {
      sum += power;
      power *= turn;
    }
  }
  return sums;
}

Stationarity::Test drift_of(const std::string& what, const std::vector<double>& x,
                            const Spectrum& spectrum) {
  constexpr int kHigh = Stationarity::kHigh;
  const auto n = static_cast<double>(x.size());
  const auto sums = sums_at(x, pi / n, kLow + kHigh);
  double low = 0.0, high = 0.0;
  std::vector<double> weights;
  for (int j = 1; j <= kLow + kHigh; ++j) {
    const double y = std::sqrt(2.0 / n) * sums[static_cast<std::size_t>(j - 1)].real();
    const double square = y * y / spectrum(pi * j / n);
    const double weight = 1.0 / (static_cast<double>(j) * j);
    if (j <= kLow) {
      low += square * weight;
      weights.push_back(weight);
    } else {
      high += square / kHigh;
    }
  }
  weights.insert(weights.end(), kHigh, -low / std::max(high, kLeastPower) / kHigh);
  return {what, positive_probability(weights), 0.0};
}

/// Tests for a period that occurs kFewest times or more and is kShortest packets or longer.
Stationarity::Test period_of(const std::string& what, const std::vector<double>& x,
                             const Spectrum& spectrum) {
  constexpr std::size_t kFewest = 4, kMost = 500, kBeside = 16, kShortest = 20;
  const auto n = static_cast<double>(x.size());
  const std::size_t count = std::min(kMost, x.size() / kShortest);
  if (count < 2 * kBeside + kFewest) return {what, 1.0, 0.0};
  const auto sums = sums_at(x, 2.0 * pi / n, count);
  std::vector<double> power;
  for (std::size_t k = 1; k <= count; ++k) {
    power.push_back(std::norm(sums[k - 1]) / (n * spectrum(2.0 * pi * static_cast<double>(k) / n)));
  }
  Stationarity::Test best{what, 1.0, 0.0};
  for (std::size_t k = kFewest; k <= count; ++k) {
    const std::size_t from = std::max(kFewest, k > kBeside ? k - kBeside : 0);
    const std::size_t to = std::min(count, from + 2 * kBeside);
    double beside = 0.0;
    for (std::size_t i = from; i <= to; ++i) beside += i == k ? 0.0 : power[i - 1];
    const auto others = static_cast<double>(to - from);
    beside = std::max(beside, kLeastPower * static_cast<double>(to - from));
    // An exponential by the mean of others.
    const double p = std::pow(1.0 + power[k - 1] / beside, -others);
    if (p < best.p_value) best = {what, p, n / static_cast<double>(k)};
  }
  best.p_value =
      std::max(kLeastP, -std::expm1(static_cast<double>(count) * std::log1p(-best.p_value)));
  return best;
}

std::array<double, 4> by_quarters(const std::vector<double>& lost) {
  std::array<double, 4> share{}, count{};
  for (std::size_t t = 0; t < lost.size(); ++t) {
    const std::size_t quarter = 4 * t / lost.size();
    share[quarter] += lost[t];
    count[quarter] += 1.0;
  }
  for (std::size_t i = 0; i < 4; ++i) share[i] /= std::max(1.0, count[i]);
  return share;
}

}  // namespace

double positive_probability(const std::vector<double>& weights) {
  // P = ½ + 1/π ∫ sin θ(u)/(u ρ(u)) du, by the midpoint rule on u = e^s: the integrand is smooth.
  constexpr double kFrom = -20.0, kTo = 14.0, kStep = 0.05;
  double largest = 0.0;
  for (const double w : weights) largest = std::max(largest, std::abs(w));
  double sum = 0.0;
  for (double s = kFrom + 0.5 * kStep; s < kTo; s += kStep) {
    const double u = std::exp(s) / largest;
    double theta = 0.0, log_rho = 0.0;
    for (const double w : weights) {
      theta += 0.5 * std::atan(w * u);
      log_rho += 0.25 * std::log1p(w * w * u * u);
    }
    sum += std::sin(theta) * std::exp(-log_rho) * kStep;
  }
  return std::clamp(0.5 + sum / pi, kLeastP, 1.0);
}

double Stationarity::p_value() const {
  if (tests.empty()) return 1.0;
  return std::min(1.0, strongest().p_value * static_cast<double>(tests.size()));
}

bool Stationarity::holds() const {
  return std::ranges::all_of(tests, [&](const Test& test) {
    return test.what != kLoss || test.p_value * static_cast<double>(tests.size()) >= kFalseAlarm;
  });
}

const Stationarity::Test& Stationarity::strongest() const {
  return *std::ranges::min_element(tests, {}, &Test::p_value);
}

Stationarity test_stationarity(const FateBits& log, const GilbertElliott& model,
                               const std::vector<double>& scores) {
  constexpr std::size_t kFewest = 400;
  std::vector<double> lost;
  for (const auto& segment : log) lost.insert(lost.end(), segment.begin(), segment.end());
  Stationarity result;
  if (lost.size() < kFewest) return result;
  result.loss = by_quarters(lost);
  const Spectrum spectrum = loss_spectrum(model, static_cast<double>(lost.size()));
  result.tests = {drift_of(kLoss, lost, spectrum), period_of(kLoss, lost, spectrum)};
  if (scores.size() < kFewest) return result;
  const std::size_t n = scores.size();
  double product = 0.0, square = 0.0;
  for (std::size_t t = 1; t < n; ++t) {
    product += scores[t] * scores[t - 1];
    square += scores[t] * scores[t];
  }
  const double most = 1.0 - Stationarity::kFewestTimes / static_cast<double>(n);
  const double c = square > 0.0 ? std::clamp(product / square, 0.0, most) : 0.0;
  std::vector<double> spread, neighbours;
  for (std::size_t t = 0; t < n; ++t) {
    spread.push_back(scores[t] * scores[t] - 1.0);
    if (t > 0) neighbours.push_back(scores[t] * scores[t - 1]);
  }
  const Spectrum level = [c](double omega) { return red(c, omega); };
  const Spectrum squares = [c](double omega) { return 2.0 * red(c * c, omega); };
  result.tests.push_back(drift_of("the delays' level", scores, level));
  result.tests.push_back(drift_of("the delays' spread", spread, squares));
  result.tests.push_back(drift_of("the delays' correlation", neighbours, squares));
  result.tests.push_back(period_of("the delays' level", scores, level));
  return result;
}

}  // namespace tether
