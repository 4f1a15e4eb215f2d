#include "netem/fit/maximum.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {
namespace {

using Vector = std::vector<double>;

double dot(const Vector& a, const Vector& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

Vector times(const DenseMatrix& m, const Vector& x) {
  Vector y(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (std::size_t j = 0; j < x.size(); ++j) y[i] += m(i, j) * x[j];
  }
  return y;
}

DenseMatrix identity(std::size_t n) {
  DenseMatrix m(n, n);
  for (std::size_t i = 0; i < n; ++i) m(i, i) = 1.0;
  return m;
}

Vector gradient(const Objective& f, Vector x) {
  constexpr double kStep = 1e-4;
  Vector g(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
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
void update(DenseMatrix& inverse, const Vector& s, const Vector& y) {
  const double curvature = dot(s, y);
  if (!(curvature > 1e-12)) return;
  const Vector hy = times(inverse, y);
  const double factor = (1.0 + dot(y, hy) / curvature) / curvature;
  for (std::size_t i = 0; i < s.size(); ++i) {
    for (std::size_t j = 0; j < s.size(); ++j) {
      inverse(i, j) += factor * s[i] * s[j] - (hy[i] * s[j] + s[i] * hy[j]) / curvature;
    }
  }
}

double second_difference(const Objective& f, const Vector& x, std::size_t i, std::size_t j,
                         double hi, double hj) {
  const auto at = [&](double a, double b) {
    Vector shifted = x;
    shifted[i] += a;
    shifted[j] += b;
    return f(shifted);
  };
  if (i == j) return (at(hi, 0.0) - 2.0 * f(x) + at(-hi, 0.0)) / (hi * hi);
  return (at(hi, hj) - at(hi, -hj) - at(-hi, hj) + at(-hi, -hj)) / (4.0 * hi * hj);
}

bool positive_definite(const DenseMatrix& m) {
  // Cholesky's decomposition exists exactly for these.
  DenseMatrix l(m.rows(), m.rows());
  for (std::size_t i = 0; i < m.rows(); ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = m(i, j);
      for (std::size_t k = 0; k < j; ++k) sum -= l(i, k) * l(j, k);
      if (i == j && !(sum > 1e-6)) return false;
      l(i, j) = i == j ? std::sqrt(sum) : sum / l(j, j);
    }
  }
  return true;
}

DenseMatrix observed_covariance(const Objective& f, const Vector& x) {
  const std::size_t n = x.size();
  // Steps of a third of a standard error: large against rounding, small against the curvature.
  Vector step(n, 1e-3);
  for (std::size_t i = 0; i < n; ++i) {
    const double curvature = -second_difference(f, x, i, i, step[i], step[i]);
    if (!(curvature > 0.0)) return {};
    step[i] = std::clamp(0.3 / std::sqrt(curvature), 1e-4, 0.1);
  }
  DenseMatrix information(n, n), covariance;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      information(i, j) = information(j, i) = -second_difference(f, x, i, j, step[i], step[j]);
      if (!std::isfinite(information(i, j))) return {};
    }
  }
  if (!positive_definite(information) || !invert(information, covariance)) return {};
  return covariance;
}

}  // namespace

Maximum maximise(const Objective& objective, Vector start) {
  constexpr int kIterations = 200;
  const std::size_t n = start.size();
  Vector x = std::move(start);
  double value = objective(x);
  Vector g = gradient(objective, x);
  DenseMatrix inverse = identity(n);
  bool fresh = true;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Vector direction = times(inverse, g);
    double longest = 0.0;
    for (double d : direction) longest = std::max(longest, std::abs(d));
    const double rise = dot(direction, g);
    if (!(rise > 1e-9)) break;
    double length = std::min(1.0, 1.0 / longest);
    Vector next = x;
    double next_value = value;
    bool climbed = false;
    for (int halving = 0; halving < 40 && !climbed; ++halving, length *= 0.5) {
      for (std::size_t i = 0; i < n; ++i) {
        next[i] = std::clamp(x[i] + length * direction[i], -kBound, kBound);
      }
      next_value = objective(next);
      climbed = next_value > value + 1e-4 * length * rise;
    }
    if (!climbed) {
      if (fresh) break;
      inverse = identity(n);  // the curvature may have been misjudged: once more from scratch
      fresh = true;
      continue;
    }
    const Vector next_g = gradient(objective, next);
    Vector s(n), y(n);
    for (std::size_t i = 0; i < n; ++i) {
      s[i] = next[i] - x[i];
      y[i] = g[i] - next_g[i];
    }
    if (fresh && dot(s, y) > 0.0) {
      for (std::size_t i = 0; i < n; ++i) inverse(i, i) = dot(s, y) / dot(y, y);
    }
    update(inverse, s, y);
    fresh = false;
    x = next;
    g = next_g;
    value = next_value;
  }
  return {x, value, observed_covariance(objective, x)};
}

}  // namespace tether
