#include "margin/theory/linear_trial.hpp"

#include <cmath>

#include "common/base/random.hpp"

namespace tether {
namespace {

struct Loop {
  Eigen::VectorXd z;
  std::size_t state;
};

std::size_t draw(const std::vector<double>& probabilities, RandomEngine& random) {
  double luck = uniform_01(random);
  for (std::size_t i = 0; i + 1 < probabilities.size(); ++i) {
    luck -= probabilities[i];
    if (luck < 0.0) return i;
  }
  return probabilities.size() - 1;
}

/// Each as often as its weight says, to less than one (systematic resampling).
std::vector<Loop> resampled(const std::vector<Loop>& loops, const std::vector<double>& weights,
                            double sum, RandomEngine& random) {
  std::vector<Loop> result;
  result.reserve(loops.size());
  const double each = sum / static_cast<double>(loops.size());
  double at = each * uniform_01(random), passed = 0.0;
  for (std::size_t i = 0; i < loops.size(); ++i) {
    passed += weights[i];
    for (; at < passed && result.size() < loops.size(); at += each) {
      result.push_back({loops[i].z / std::sqrt(weights[i]), loops[i].state});
    }
  }
  while (result.size() < loops.size()) result.push_back(result.back());  // rounding
  return result;
}

}  // namespace

double simulated_radius(const LossChain& chain, const std::vector<LoopStep>& steps,
                        const LinearTrial& trial) {
  RandomEngine random = random_stream(trial.seed, "margin/linear trial");
  std::vector<std::vector<const LossChain::Jump*>> jumps(chain.states);
  std::vector<std::vector<double>> probabilities(chain.states);
  for (const auto& jump : chain.jumps) {
    jumps[jump.from].push_back(&jump);
    probabilities[jump.from].push_back(jump.probability);
  }
  const Eigen::Index n = steps.front().a[0].rows();
  std::vector<Loop> loops;
  for (std::size_t i = 0; i < trial.loops; ++i) {
    Eigen::VectorXd z(n);
    for (double& component : z) component = uniform_01(random) - 0.5;
    loops.push_back({z.normalized(), draw(chain.stationary, random)});
  }
  const std::size_t settling = trial.periods / 3;
  double log_growth = 0.0;
  std::vector<double> weights(trial.loops);
  for (std::size_t k = 0; k < trial.periods; ++k) {
    double sum = 0.0;
    for (std::size_t i = 0; i < trial.loops; ++i) {
      Loop& loop = loops[i];
      const auto& jump = *jumps[loop.state][draw(probabilities[loop.state], random)];
      loop.z = steps[k % steps.size()].a[jump.mode] * loop.z;
      loop.state = jump.to;
      weights[i] = loop.z.squaredNorm();
      sum += weights[i];
    }
    if (!(sum > 0.0)) return 0.0;
    if (k >= settling) log_growth += std::log(sum / static_cast<double>(trial.loops));
    loops = resampled(loops, weights, sum, random);
  }
  return std::exp(log_growth / static_cast<double>(trial.periods - settling));
}

}  // namespace tether
