#include "netem/fit/stationarity.hpp"

#include <algorithm>
#include <boost/math/distributions/fisher_f.hpp>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace tether {
namespace {

/// Spectral density of the losses of a Gilbert–Elliott channel.
class Spectrum {
 public:
  Spectrum(const GilbertElliott& m, double packets) {
    const double bad = m.p + m.r > 0.0 ? m.p / (m.p + m.r) : 0.0;
    const double loss = bad * m.one_minus_h + (1.0 - bad) * m.one_minus_k;
    const double difference = m.one_minus_h - m.one_minus_k;
    states_ = bad * (1.0 - bad) * difference * difference;
    tosses_ = loss * (1.0 - loss) - states_;
    lambda_ = std::min(1.0 - m.p - m.r, 1.0 - Stationarity::kFewestTimes / packets);
  }
  double at(double omega) const {
    const double l = lambda_;
    return tosses_ + states_ * (1.0 - l * l) / (1.0 - 2.0 * l * std::cos(omega) + l * l);
  }

 private:
  double states_, tosses_, lambda_;
};

/// Y_1 … Y_count; the mean of the losses does not matter, since the cosines add up to 0.
std::vector<double> cosine_sums(const FateBits& log, double packets, int count) {
  std::vector<double> sums(static_cast<std::size_t>(count), 0.0);
  double t = 0.0;
  for (const auto& segment : log) {
    for (const std::uint8_t lost : segment) {
      const double angle = std::numbers::pi * (t + 0.5) / packets;
      t += 1.0;
      if (lost == 0) continue;
      const std::complex<double> turn(std::cos(angle), std::sin(angle));
      std::complex<double> power = turn;
      for (double& sum : sums) {
        sum += power.real();
        power *= turn;
      }
    }
  }
  for (double& sum : sums) sum *= std::sqrt(2.0 / packets);
  return sums;
}

std::array<double, 4> by_quarters(const FateBits& log, std::size_t packets) {
  std::array<double, 4> lost{}, count{};
  std::size_t t = 0;
  for (const auto& segment : log) {
    for (const std::uint8_t bit : segment) {
      const std::size_t quarter = 4 * t++ / packets;
      lost[quarter] += bit;
      count[quarter] += 1.0;
    }
  }
  for (std::size_t i = 0; i < 4; ++i) lost[i] /= std::max(1.0, count[i]);
  return lost;
}

}  // namespace

Stationarity test_stationarity(const FateBits& log, const GilbertElliott& model) {
  constexpr int kLow = Stationarity::kLow, kHigh = Stationarity::kHigh;
  std::size_t packets = 0;
  for (const auto& segment : log) packets += segment.size();
  Stationarity result;
  if (packets < std::size_t{10} * (kLow + kHigh)) return result;
  const auto n = static_cast<double>(packets);
  const Spectrum spectrum(model, n);
  const std::vector<double> y = cosine_sums(log, n, kLow + kHigh);
  double low = 0.0, high = 0.0;
  for (int j = 1; j <= kLow + kHigh; ++j) {
    const double value = y[static_cast<std::size_t>(j - 1)];
    (j <= kLow ? low : high) += value * value / spectrum.at(std::numbers::pi * j / n);
  }
  result.loss = by_quarters(log, packets);
  if (!(high > 0.0)) return result;
  result.f = (low / kLow) / (high / kHigh);
  const boost::math::fisher_f law(kLow, kHigh);
  result.p_value = boost::math::cdf(boost::math::complement(law, result.f));
  return result;
}

}  // namespace tether
