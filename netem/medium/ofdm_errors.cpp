#include "netem/medium/ofdm_errors.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <span>

namespace tether {
namespace {

/// Errors of a punctured code: weights of distances first, first + step, …
struct Code {
  int k;  ///< numerator of its rate k/n
  int first, step;
  std::span<const double> weights;
};
constexpr double kHalf[] = {36, 211, 1404, 11633, 77433, 502690, 3322763, 21292910, 134365911};
constexpr double kTwoThirds[] = {3, 70, 285, 1276, 6160, 27128, 117019, 498860, 2103891, 8784123};
constexpr double kThreeQuarters[] = {42,     201,     1492,     10469,    62935,
                                     379644, 2253373, 13073811, 75152755, 428005675};
constexpr Code kCodes[] = {{1, 10, 2, kHalf}, {2, 6, 1, kTwoThirds}, {3, 5, 1, kThreeQuarters}};

/// A coded bit's error is `share`·erfc √(snr/`spread`).
struct Modulation {
  double share, spread;
};
constexpr Modulation kBpsk{0.5, 1.0}, kQpsk{0.5, 2.0}, kQam16{0.375, 10.0}, kQam64{7.0 / 24, 42.0};

struct Scheme {
  Modulation modulation;
  const Code& code;
};
/// In the order of kOfdmRates_Mbps.
constexpr Scheme kSchemes[] = {{kBpsk, kCodes[0]},  {kBpsk, kCodes[2]},  {kQpsk, kCodes[0]},
                               {kQpsk, kCodes[2]},  {kQam16, kCodes[0]}, {kQam16, kCodes[2]},
                               {kQam64, kCodes[1]}, {kQam64, kCodes[2]}};

/// Error probability of a decoded bit, at most 1.
double decoded_error(const Code& code, double coded_error) {
  const double d = std::sqrt(4.0 * coded_error * (1.0 - coded_error));
  const double step = std::pow(d, code.step);
  double sum = 0.0;
  for (auto weight = code.weights.rbegin(); weight != code.weights.rend(); ++weight) {
    sum = sum * step + *weight;
  }
  return std::min(1.0, sum * std::pow(d, code.first) / (2.0 * code.k));
}

}  // namespace

double frame_error_ratio(double rate_Mbps, int bits, double snr_db) {
  const auto* found = std::find(kOfdmRates_Mbps.begin(), kOfdmRates_Mbps.end(), rate_Mbps);
  assert(found != kOfdmRates_Mbps.end());
  const auto& [modulation, code] = kSchemes[found - kOfdmRates_Mbps.begin()];
  const double snr = std::pow(10.0, 0.1 * snr_db);
  const double coded_error = modulation.share * std::erfc(std::sqrt(snr / modulation.spread));
  const double error = decoded_error(code, coded_error);
  return error < 1.0 ? -std::expm1(bits * std::log1p(-error)) : 1.0;
}

double best_rate_mbps(double highest_Mbps, int bytes, double snr_db, double error_ratio) {
  for (auto rate = kOfdmRates_Mbps.rbegin(); rate != kOfdmRates_Mbps.rend(); ++rate) {
    if (*rate > highest_Mbps) continue;
    if (frame_error_ratio(*rate, frame_bits(bytes), snr_db) <= error_ratio) return *rate;
  }
  return kOfdmRates_Mbps.front();
}

}  // namespace tether
