#pragma once

#include <vector>

#include "common/base/random.hpp"

namespace tether {

/// Log-normal shadowing as a function of position: a Gaussian random field in dB with mean 0,
/// standard deviation σ and, over the distance d, the correlation exp(−d/D) of Gudmundson
/// (Electronics Letters 27(23), 1991), the same in all directions.
///
/// One realisation is a sum of waves, σ·√(2/N)·Σ cos(k_i·x + φ_i), which is a function of the
/// position alone: whichever way, and however often, a vehicle passes, it finds the same value
/// there (Cai & Giannakis, IEEE Trans. Vehicular Technology 52(6), 2003, with random wave vectors).
/// The directions and phases are uniform. The wave numbers follow the field's spectrum, whose
/// distribution is F(k) = 1 − 1/√(1 + (kD)²): k = √((1 − u)⁻² − 1)/D, u one of N equal parts of
/// (0, 1), uniform within its part. Over realisations mean, variance and correlation are exact;
/// values are normal as sums of N = 500 terms are.
class Shadowing {
 public:
  static constexpr int kWaves = 500;

  /// 3·kWaves draws. sd_db >= 0, distance_m > 0.
  Shadowing(double sd_db, double distance_m, RandomEngine& random);

  /// About 5 µs: for positions, not for packets.
  double at(double x_m, double y_m) const;

 private:
  struct Wave {
    double kx, ky;  // rad/m
    double phase;   // rad
  };
  double amplitude_db_;
  std::vector<Wave> waves_;
};

}  // namespace tether
