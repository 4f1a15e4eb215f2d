#include "netem/fit/maximum.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd gradient(const Objective& f, VectorXd x) {
  constexpr double kStep = 1e-4;
  VectorXd g(x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    const double centre = x[i];
    x[i] = centre + kStep;
    const double above = f(x);
    x[i] = centre - kStep;
    const double below = f(x);
    x[i] = centre;
    g[i] = std::isfinite(above) && std::isfinite(below) ? (above - below) / (2.0 * kStep) : 0.0;
  }
  return g;
}

/// The BFGS update of the inverse Hessian of −f, after a step s that changed −f's gradient by y.
void update(MatrixXd& inverse, const VectorXd& s, const VectorXd& y) {
  const double curvature = s.dot(y);
  if (!(curvature > 1e-12)) return;
  const VectorXd hy = inverse * y;
  const double factor = (1.0 + y.dot(hy) / curvature) / curvature;
  inverse += factor * s * s.transpose() - (hy * s.transpose() + s * hy.transpose()) / curvature;
}

double second_difference(const Objective& f, const VectorXd& x, Eigen::Index i, Eigen::Index j,
                         double hi, double hj) {
  const auto at = [&](double a, double b) {
    VectorXd shifted = x;
    shifted[i] += a;
    shifted[j] += b;
    return f(shifted);
  };
  if (i == j) return (at(hi, 0.0) - 2.0 * f(x) + at(-hi, 0.0)) / (hi * hi);
  return (at(hi, hj) - at(hi, -hj) - at(-hi, hj) + at(-hi, -hj)) / (4.0 * hi * hj);
}

MatrixXd observed_covariance(const Objective& f, const VectorXd& x) {
  const Eigen::Index n = x.size();
  // Steps of a third of a standard error: large against rounding, small against the curvature.
  VectorXd step = VectorXd::Constant(n, 1e-3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double curvature = -second_difference(f, x, i, i, step[i], step[i]);
    if (!(curvature > 0.0)) return {};
    step[i] = std::clamp(0.3 / std::sqrt(curvature), 1e-4, 0.1);
  }
  MatrixXd information(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      information(i, j) = information(j, i) = -second_difference(f, x, i, j, step[i], step[j]);
    }
  }
  if (!information.allFinite()) return {};
  const Eigen::LLT<MatrixXd> cholesky(information);
  constexpr double kFlat = 1e-3;  // tolerance for the factor, whose diagonal has roots
  if (cholesky.info() != Eigen::Success) return {};
  if (!(cholesky.matrixLLT().diagonal().minCoeff() > kFlat)) return {};
  return cholesky.solve(MatrixXd::Identity(n, n));
}

}  // namespace

Maximum maximise(const Objective& objective, VectorXd start) {
  constexpr int kIterations = 200;
  const Eigen::Index n = start.size();
  VectorXd x = std::move(start);
  double value = objective(x);
  VectorXd g = gradient(objective, x);
  MatrixXd inverse = MatrixXd::Identity(n, n);
  bool fresh = true;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const VectorXd direction = inverse * g;
    const double rise = direction.dot(g);
    if (!(rise > 1e-9)) break;
    double length = std::min(1.0, 1.0 / direction.cwiseAbs().maxCoeff());
    VectorXd next;
    double next_value = value;
    bool climbed = false;
    for (int halving = 0; halving < 40 && !climbed; ++halving, length *= 0.5) {
      next = (x + length * direction).cwiseMax(-kBound).cwiseMin(kBound);
      next_value = objective(next);
      climbed = next_value > value + 1e-4 * length * rise;
    }
    if (!climbed) {
      if (fresh) break;
      inverse.setIdentity();  // the curvature may have been misjudged: once more from scratch
      fresh = true;
      continue;
    }
    const VectorXd next_g = gradient(objective, next);
    const VectorXd s = next - x, y = g - next_g;
    if (fresh && s.dot(y) > 0.0) inverse.diagonal().setConstant(s.dot(y) / y.dot(y));
    update(inverse, s, y);
    fresh = false;
    x = next;
    g = next_g;
    value = next_value;
  }
  return {x, value, observed_covariance(objective, x)};
}

}  // namespace tether
