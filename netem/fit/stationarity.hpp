#pragma once

#include <array>
#include <string>
#include <vector>

#include "netem/fit/delays.hpp"
#include "netem/fit/goodness.hpp"
#include "netem/models/gilbert_elliott.hpp"

namespace tether {

/// Whether losses and delays stay the same all through a log.
///
/// Let x_t be a series with n values. Y_j = √(2/n) Σ_t x_t cos(π j (t + ½)/n), j ≥ 1, are nearly
/// independent, with mean 0 and variance S(π j/n), S the spectral density of x if it is stationary
/// (Müller, Econometrica 76(5), 2008). What drifts, steps or bulges has its energy in the lowest of
/// them. Σ Y_j²/(S j²) is the mean square of the CUSUM, with the variance that S gives it (Nyblom,
/// JASA 84(405), 1989: locally the most powerful against a level that wanders). Divided by the mean
/// of Y_j²/S over the next kHigh, it is a ratio of quadratic forms, whose law Imhof's integral
/// gives (Biometrika 48, 1961). What comes and goes with a period is in one frequency: the largest
/// of |Σ_t x_t e^{−2πi k t/n}|²/S, by the mean of its neighbours'.
///
/// Series are: losses; of delays their normal scores (level), the scores' squares (spread) and
/// neighbours' products (correlation). S is the fitted model's, so that bursts are no drift: with
/// C = π_G π_B (e_B − e_G)² and λ = 1 − p − r of losses, S(ω) = P(1−P) − C + C (1−λ²)/(1 − 2λ cos ω
/// + λ²). A model may explain by it what has come and gone often enough: 1/(p + r) counts as
/// n/kFewestTimes packets at most. Slower states cannot be distinguished from a drift by this log,
/// and are called one.
struct Stationarity {
  static constexpr int kHigh = 40;
  static constexpr double kFewestTimes = 20.0;
  /// Probability that a stationary log is called changing, and doubtful, all tests together (Holm).
  static constexpr double kFalseAlarm = 1e-3, kDoubt = 0.05;

  struct Test {
    std::string what;  ///< "the loss", "the delays' spread"
    double p_value = 1.0;
    double period_packets = 0.0;  ///< period found by the tests
  };
  std::vector<Test> tests;
  std::array<double, 4> loss{};  ///< shares lost in the first to the last quarter of the packets

  /// Holm's first step: the smallest p-value times the number of tests; 1 without tests.
  double p_value() const;
  /// The test with the smallest p-value; there is one.
  const Test& strongest() const;
  /// Verdict on the losses alone: delays follow the machine that recorded them, too.
  bool holds() const;
  /// Verdict on losses and delays.
  bool beyond_doubt() const { return p_value() >= kDoubt; }
};

/// `model`: the one that was fitted; of independent losses p = 0. `scores`: normal scores of delays
/// (delay_scores()), or empty.
Stationarity test_stationarity(const FateBits& log, const GilbertElliott& model,
                               const std::vector<double>& scores = {});

/// P[Σ weights_i Z_i² > 0] of independent standard normal Z, some weights below 0 (Imhof, 1961).
double positive_probability(const std::vector<double>& weights);

}  // namespace tether
