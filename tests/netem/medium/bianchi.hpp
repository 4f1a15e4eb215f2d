#pragma once

#include <cmath>

namespace tether {

/// Saturation of a DCF without retry limit: G. Bianchi, "Performance Analysis of the IEEE 802.11
/// Distributed Coordination Function", IEEE JSAC 18(3), 2000, equations 7 to 13.
struct Bianchi {
  double collision = 0.0;  ///< p: of an attempt
  double tau = 0.0;        ///< an attempt in a slot, of one station

  /// `window`: the smallest, W; it doubles `stages` times, m.
  Bianchi(int stations, int window, int stages) : n_(stations) {
    double low = 0.0, high = 1.0;
    for (int i = 0; i < 100; ++i) {
      collision = 0.5 * (low + high);
      double doublings = 0.0;  // the sum of (2p)^k, which the paper writes as a quotient
      for (int k = 0; k < stages; ++k) doublings += std::pow(2.0 * collision, k);
      tau = 2.0 / (1.0 + window + collision * window * doublings);
      (1.0 - std::pow(1.0 - tau, n_ - 1) > collision ? low : high) = collision;
    }
  }

  /// Share of time that carries payload. All in the same unit of time.
  double throughput(double payload, double slot, double success, double collided) const {
    const double busy = 1.0 - std::pow(1.0 - tau, n_);
    const double one = n_ * tau * std::pow(1.0 - tau, n_ - 1) / busy;
    return one * busy * payload /
           ((1.0 - busy) * slot + busy * one * success + busy * (1.0 - one) * collided);
  }

 private:
  int n_;
};

}  // namespace tether
