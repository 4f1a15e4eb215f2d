#pragma once

#include <cmath>

namespace tether {

/// Noise of unit variance whose correlation falls by e in `correlation_s`, sampled at `rate_hz`:
/// the first-order Gauss–Markov process
///   e_0 = w_0,   e_n = a e_{n−1} + √(1 − a²) w_n,   a = exp(−1/(rate · correlation time)),
/// with w white of unit variance. It is stationary from the first sample on: each has the variance
/// of w, and samples k apart have the correlation a^k. correlation_s = 0: e = w, to the bit.
class GaussMarkov {
 public:
  GaussMarkov(double correlation_s, double rate_hz)
      : keep_(correlation_s > 0.0 ? std::exp(-1.0 / (rate_hz * correlation_s)) : 0.0),
        renew_(std::sqrt(1.0 - keep_ * keep_)) {}

  double next(double white) {
    value_ = any_ ? keep_ * value_ + renew_ * white : white;
    any_ = true;
    return value_;
  }

 private:
  double keep_;
  double renew_;
  double value_ = 0.0;
  bool any_ = false;
};

}  // namespace tether
