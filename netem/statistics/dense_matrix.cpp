#include "netem/statistics/dense_matrix.hpp"

#include <cassert>
#include <cmath>
#include <utility>

namespace tether {
namespace {

void swap_rows(DenseMatrix& m, std::size_t i, std::size_t j) {
  for (std::size_t c = 0; c < m.columns(); ++c) std::swap(m(i, c), m(j, c));
}

// row i −= factor · row j
void subtract_row(DenseMatrix& m, std::size_t i, std::size_t j, double factor) {
  for (std::size_t c = 0; c < m.columns(); ++c) m(i, c) -= factor * m(j, c);
}

}  // namespace

bool solve(DenseMatrix a, DenseMatrix b, DenseMatrix& x) {
  assert(a.rows() == a.columns() && a.rows() == b.rows());
  const std::size_t n = a.rows();
  double scale = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) scale = std::max(scale, std::abs(a(i, j)));
  }
  for (std::size_t column = 0; column < n; ++column) {
    std::size_t pivot = column;
    for (std::size_t row = column + 1; row < n; ++row) {
      if (std::abs(a(row, column)) > std::abs(a(pivot, column))) pivot = row;
    }
    if (!(std::abs(a(pivot, column)) > 1e-14 * scale)) return false;
    swap_rows(a, pivot, column);
    swap_rows(b, pivot, column);
    for (std::size_t row = 0; row < n; ++row) {
      if (row == column) continue;
      const double factor = a(row, column) / a(column, column);
      if (factor == 0.0) continue;
      subtract_row(a, row, column, factor);
      subtract_row(b, row, column, factor);
    }
  }
  for (std::size_t row = 0; row < n; ++row) {
    for (std::size_t c = 0; c < b.columns(); ++c) b(row, c) /= a(row, row);
  }
  x = std::move(b);
  return true;
}

bool invert(const DenseMatrix& a, DenseMatrix& inverse) {
  DenseMatrix identity(a.rows(), a.rows());
  for (std::size_t i = 0; i < a.rows(); ++i) identity(i, i) = 1.0;
  return solve(a, std::move(identity), inverse);
}

std::vector<double> stationary_shares(const DenseMatrix& transition) {
  // The equations (Pᵀ − I)π = 0 depend on each other; the last gives way to Σπ = 1.
  const std::size_t n = transition.rows();
  DenseMatrix a(n, n), b(n, 1), x;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      a(i, j) = i + 1 == n ? 1.0 : transition(j, i) - (i == j ? 1.0 : 0.0);
    }
  }
  b(n - 1, 0) = 1.0;
  if (!solve(std::move(a), std::move(b), x)) return {};
  std::vector<double> stationary(n);
  for (std::size_t i = 0; i < n; ++i) stationary[i] = std::max(0.0, x(i, 0));
  return stationary;
}

DenseMatrix asymptotic_covariance(const DenseMatrix& transition,
                                  const std::vector<double>& stationary,
                                  const DenseMatrix& functions) {
  const std::size_t n = transition.rows(), m = functions.columns();
  DenseMatrix centred = functions, a(n, n), g;
  for (std::size_t i = 0; i < m; ++i) {
    double mean = 0.0;
    for (std::size_t s = 0; s < n; ++s) mean += stationary[s] * functions(s, i);
    for (std::size_t s = 0; s < n; ++s) centred(s, i) -= mean;
  }
  for (std::size_t s = 0; s < n; ++s) {
    for (std::size_t t = 0; t < n; ++t) {
      a(s, t) = (s == t ? 1.0 : 0.0) - transition(s, t) + stationary[t];
    }
  }
  const bool solved = solve(std::move(a), centred, g);
  assert(solved && "a chain with a unique stationary distribution has a fundamental matrix");
  DenseMatrix covariance(m, m);
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t j = 0; j < m; ++j) {
      for (std::size_t s = 0; s < n; ++s) {
        covariance(i, j) += stationary[s] * (centred(s, i) * g(s, j) + centred(s, j) * g(s, i) -
                                             centred(s, i) * centred(s, j));
      }
    }
  }
  return covariance;
}

}  // namespace tether
