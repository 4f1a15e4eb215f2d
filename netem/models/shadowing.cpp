#include "netem/models/shadowing.hpp"

#include <cassert>
#include <cmath>
#include <numbers>

namespace tether {

Shadowing::Shadowing(double sd_db, double distance_m, RandomEngine& random)
    : amplitude_db_(sd_db * std::sqrt(2.0 / kWaves)) {
  assert(sd_db >= 0.0 && distance_m > 0.0);
  const auto uniform = [&random] { return uniform_01(random); };
  for (int i = 0; i < kWaves; ++i) {
    const double rest = 1.0 - (i + uniform()) / kWaves;  // in (0, 1]
    const double k = std::sqrt(1.0 / (rest * rest) - 1.0) / distance_m;
    const double direction = 2.0 * std::numbers::pi * uniform();
    const double phase = 2.0 * std::numbers::pi * uniform();
    waves_.push_back({k * std::cos(direction), k * std::sin(direction), phase});
  }
}

double Shadowing::at(double x_m, double y_m) const {
  if (amplitude_db_ == 0.0) return 0.0;
  double sum = 0.0;
  for (const Wave& w : waves_) sum += std::cos(w.kx * x_m + w.ky * y_m + w.phase);
  return amplitude_db_ * sum;
}

}  // namespace tether
