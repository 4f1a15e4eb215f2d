#pragma once

#include <array>

#include "netem/fit/goodness.hpp"
#include "netem/models/gilbert_elliott.hpp"

namespace tether {

/// Whether the share of lost packets stays the same all through a log.
///
/// With n packets and x_t = 1 for a lost one, Y_j = √(2/n) Σ_t x_t cos(π j (t + ½)/n), j ≥ 1, of a
/// stationary channel are nearly independent, with mean 0 and variance S(π j/n), S its spectral
/// density (Müller, Econometrica 76(5), 2008). What drifts, steps or bulges has its energy in the
/// lowest of them. So F = mean of Y_j²/S over j = 1 … kLow, divided by the mean over the next
/// kHigh, has the F law with kLow and kHigh degrees of freedom.
///
/// S is the fitted model's, so that bursts are no drift: with C = π_G π_B (e_B − e_G)² and
/// λ = 1 − p − r, S(ω) = P(1−P) − C + C (1−λ²)/(1 − 2λ cos ω + λ²). A model may explain by it what
/// has come and gone often enough: 1/(p + r) counts as n/kFewestTimes packets at most. Slower
/// states cannot be told from a drift by this log, and are called one.
struct Stationarity {
  static constexpr int kLow = 3, kHigh = 16;
  static constexpr double kFewestTimes = 20.0;
  static constexpr double kFalseAlarm = 1e-3;

  double f = 1.0;
  double p_value = 1.0;
  std::array<double, 4> loss{};  ///< shares lost in the first to the last quarter of the packets

  bool holds() const { return p_value >= kFalseAlarm; }
};

/// `model`: the one that was fitted; of independent losses p = 0.
Stationarity test_stationarity(const FateBits& log, const GilbertElliott& model);

}  // namespace tether
