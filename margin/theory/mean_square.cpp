#include "margin/theory/mean_square.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

using Moments = std::vector<Eigen::MatrixXd>;  // moments of each state of the chain
using Modes = std::vector<const Eigen::MatrixXd*>;

constexpr double kSettled = 1e-10;
constexpr std::size_t kMostSteps = 100'000;

Moments moved(const LossChain& chain, const Modes& modes, const Moments& x) {
  const Eigen::Index n = x.front().rows();
  Moments next(chain.states, Eigen::MatrixXd::Zero(n, n));
  std::vector<Moments> images(chain.states, Moments(modes.size()));  // each product once
  for (const auto& jump : chain.jumps) {
    Eigen::MatrixXd& image = images[jump.from][jump.mode];
    if (image.size() == 0) {
      image.noalias() = (*modes[jump.mode] * x[jump.from]).eval() * modes[jump.mode]->transpose();
    }
    next[jump.to] += jump.probability * image;
  }
  return next;
}

double trace(const Moments& x) {
  double sum = 0.0;
  for (const auto& of_state : x) sum += of_state.trace();
  return sum;
}

void scale(Moments& x, double factor) {
  for (auto& of_state : x) of_state *= factor;
}

double radius(const LossChain& chain, const std::vector<Modes>& steps) {
  const Eigen::Index n = steps.front().front()->rows();
  Moments x(chain.states, Eigen::MatrixXd::Identity(n, n));
  scale(x, 1.0 / trace(x));
  const auto count = static_cast<double>(steps.size());
  double before = 0.0, result = 0.0;
  int quiet = 0;
  for (std::size_t done = 0; done < kMostSteps && quiet < 5; done += steps.size()) {
    const Moments old = x;
    double log_growth = 0.0;
    for (const Modes& modes : steps) {
      x = moved(chain, modes, x);
      const double grown = trace(x);
      if (!(grown > 0.0)) return 0.0;  // nilpotent
      log_growth += std::log(grown);
      scale(x, 1.0 / grown);
    }
    // The shift by the identity: of a product of steps in proportion to its growth.
    for (std::size_t s = 0; s < x.size(); ++s) {
      x[s] = log_growth < 0.0 ? (std::exp(log_growth) * x[s] + old[s]).eval()
                              : (x[s] + std::exp(-log_growth) * old[s]).eval();
    }
    scale(x, 1.0 / trace(x));
    result = std::exp(log_growth / count);
    quiet = std::abs(result - before) < kSettled * std::max(1.0, result) ? quiet + 1 : 0;
    before = result;
  }
  return result;
}

}  // namespace

double mean_square_radius(const LossChain& chain, const std::vector<LoopStep>& steps) {
  std::vector<Modes> modes;
  for (const LoopStep& step : steps) modes.push_back({&step.a[0], &step.a[1]});
  return radius(chain, modes);
}

double mean_square_radius(const Matrix& p, const std::vector<Eigen::MatrixXd>& modes) {
  LossChain chain{.states = modes.size(), .jumps = {}, .stationary = {}};
  Modes one;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    one.push_back(&modes[i]);
    for (std::size_t j = 0; j < modes.size(); ++j) chain.jumps.push_back({i, j, p[i][j], i});
  }
  return radius(chain, {one});
}

std::optional<std::vector<Eigen::MatrixXd>> stationary_moments(const LossChain& chain,
                                                               const std::vector<LoopStep>& steps) {
  const Eigen::Index last = steps.front().a[0].rows() - 1;
  Moments x(chain.states, Eigen::MatrixXd::Zero(last + 1, last + 1));
  for (std::size_t s = 0; s < chain.states; ++s) x[s](last, last) = chain.stationary[s];
  double before = 0.0;
  for (std::size_t done = 0; done < kMostSteps; done += steps.size()) {
    std::vector<Eigen::MatrixXd> sums;
    for (const LoopStep& step : steps) {
      Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(last + 1, last + 1);
      for (const auto& of_state : x) sum += of_state;
      sums.push_back(sum);
      Moments next = moved(chain, {&step.a[0], &step.a[1]}, x);
      for (const auto& jump : chain.jumps) {
        next[jump.to] += jump.probability * x[jump.from](last, last) * step.noise[jump.mode];
      }
      x = std::move(next);
    }
    const double now = trace(x);
    if (!std::isfinite(now)) return std::nullopt;
    if (std::abs(now - before) < kSettled * now && done > 0) return sums;
    before = now;
  }
  return std::nullopt;
}

}  // namespace tether
