#include "tools/margin/mean_square.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "tools/margin/loss_chain.hpp"

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

Critical critical_value(const std::function<double(double)>& radius, double low, double high,
                        double tolerance) {
  constexpr int kPoints = 25;
  constexpr double kRounding = 1e-7;
  const auto is_stable = [&](double x) { return radius(x) < 1.0 + kRounding; };
  const bool first = is_stable(low);
  double x = low;
  bool stable = first;
  std::optional<double> below, above;
  for (int i = 1; i < kPoints; ++i) {
    const double next = low + (high - low) * i / (kPoints - 1);
    const bool next_stable = is_stable(next);
    if (next_stable != stable) {
      if (below) return {Critical::Kind::not_monotone, 0.0};
      below = x;
      above = next;
    }
    x = next;
    stable = next_stable;
  }
  if (!below) return {first ? Critical::Kind::always : Critical::Kind::never, 0.0};
  while (*above - *below > tolerance) {
    const double middle = 0.5 * (*below + *above);
    (is_stable(middle) == first ? below : above) = middle;
  }
  return {Critical::Kind::found, 0.5 * (*below + *above)};
}

}  // namespace tether
