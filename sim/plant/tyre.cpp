#include "sim/plant/tyre.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

// Time constant of the rubber's loss: at the 14 Hz of vehicle against tyres at rest, a loss factor
// of 0.4. Assumed; while the wheel rolls it changes next to nothing.
constexpr double kLoss_s = 5e-3;

double norm(const BrushTyre::Vector& v) { return std::hypot(v[0], v[1]); }

}  // namespace

double BrushTyre::steady_force(const Config& config, double slip, double pressing_N) {
  if (config.friction <= 0.0 || pressing_N <= 0.0) return 0.0;
  const double x = std::min(1.0, std::abs(slip) / sliding_slip(config));
  return config.friction * pressing_N * x * (3.0 - x * (3.0 - x));
}

BrushTyre::Row BrushTyre::prepare(const Vector& slip_mps, double rolling_mps, double pressing_N,
                                  double step_s) {
  step_s_ = step_s;
  const double release = 1.0 + std::abs(rolling_mps) * step_s / config_.relaxation_m;
  const double loss = kLoss_s / step_s;
  const Vector& u = deflection_m_;
  Vector stretch{};
  for (const int i : {0, 1}) {
    const double next_m = (u[i] + step_s * slip_mps[i]) / release;
    stretch[i] = next_m + loss * (next_m - u[i]);
  }
  // At no stretch the secant is the tangent; a tenth of a per mille of sliding is close enough.
  const double slip = std::max(norm(stretch) / config_.relaxation_m, 1e-4 * sliding_slip(config_));
  const double force = steady_force(config_, slip, pressing_N);
  stiffness_Npm_ = force > 0.0 ? force / (slip * config_.relaxation_m) : 0.0;
  Row row;
  if (stiffness_Npm_ == 0.0) return row;
  // F = −K (u' (1 + loss) − loss u) with u' = (u + h V')/release, solved for V'.
  const double give = release / (step_s * (1.0 + loss));
  row.softness_mps_N = give / stiffness_Npm_;
  for (const int i : {0, 1}) row.bias_mps[i] = u[i] * (loss * give - 1.0 / step_s);
  return row;
}

void BrushTyre::finish(const Vector& force_N) {
  if (stiffness_Npm_ == 0.0) {
    deflection_m_ = {};
    return;
  }
  const double loss = kLoss_s / step_s_;
  Vector& u = deflection_m_;
  for (const int i : {0, 1}) u[i] = (loss * u[i] - force_N[i] / stiffness_Npm_) / (1.0 + loss);
  // Bristles that slide are stretched no further.
  const double most_m = sliding_slip(config_) * config_.relaxation_m;
  const double size_m = norm(u);
  if (size_m > most_m) u = {u[0] * most_m / size_m, u[1] * most_m / size_m};
}

}  // namespace tether
