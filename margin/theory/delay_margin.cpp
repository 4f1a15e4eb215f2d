#include "margin/theory/delay_margin.hpp"

#include <algorithm>
#include <cmath>
#include <complex>

namespace tether {

double SteeringLoop::crossover_radps() const {
  const double a = k_theta * v_mps, b = k_y * v_mps * v_mps;
  return std::sqrt(0.5 * (a * a + std::sqrt(a * a * a * a + 4.0 * b * b)));
}

double SteeringLoop::delay_margin_s() const {
  const double omega = crossover_radps();
  return std::atan(k_theta * v_mps * omega / (k_y * v_mps * v_mps)) / omega;
}

double SteeringLoop::varying_delay_margin_s() const {
  const double a = k_theta * v_mps, b = k_y * v_mps * v_mps;
  double most = a;  // in the limit of large ω
  const double about = std::sqrt(b);
  for (double omega = 1e-2 * about; omega < 1e3 * about; omega *= 1.001) {
    const std::complex<double> s(0.0, omega);
    most = std::max(most, std::abs(s * (a * s + b) / (s * s + a * s + b)));
  }
  return 1.0 / most;
}

}  // namespace tether
