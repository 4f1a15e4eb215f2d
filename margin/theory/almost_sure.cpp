#include "margin/theory/almost_sure.hpp"

#include <cmath>

#include "margin/theory/loss_walk.hpp"

namespace tether {

double almost_sure_growth(const LossChain& chain, const std::vector<LoopStep>& steps,
                          const LyapunovTrial& trial) {
  LossWalk walk(chain, random_stream(trial.seed, "margin/lyapunov"));
  const Eigen::Index n = steps.front().a[0].rows();
  Eigen::VectorXd z(n);
  for (Eigen::Index i = 0; i < n; ++i) z(i) = std::cos(static_cast<double>(i));  // in no subspace
  z.normalize();
  const std::size_t settling = trial.periods / 10;
  double log_growth = 0.0;
  for (std::size_t k = 0; k < trial.periods; ++k) {
    z = steps[k % steps.size()].a[walk.step()] * z;
    const double grown = z.norm();
    if (!(grown > 0.0)) return 0.0;
    z /= grown;
    if (k >= settling) log_growth += std::log(grown);
  }
  return std::exp(log_growth / static_cast<double>(trial.periods - settling));
}

}  // namespace tether
