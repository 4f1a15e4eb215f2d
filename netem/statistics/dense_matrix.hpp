#pragma once

#include <cstddef>
#include <vector>

namespace tether {

/// A small dense matrix, row by row; for chains of some dozen states, so plain O(n³) is enough.
class DenseMatrix {
 public:
  DenseMatrix() = default;
  DenseMatrix(std::size_t rows, std::size_t columns)
      : rows_(rows), columns_(columns), values_(rows * columns) {}

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  double& operator()(std::size_t row, std::size_t column) {
    return values_[row * columns_ + column];
  }
  double operator()(std::size_t row, std::size_t column) const {
    return values_[row * columns_ + column];
  }

 private:
  std::size_t rows_ = 0;
  std::size_t columns_ = 0;
  std::vector<double> values_;
};

/// X with a·X = b, by Gaussian elimination with partial pivoting; `a` is square. Returns false,
/// and leaves `x` alone, if `a` is singular to working precision.
bool solve(DenseMatrix a, DenseMatrix b, DenseMatrix& x);

/// False if `a` is singular to working precision.
bool invert(const DenseMatrix& a, DenseMatrix& inverse);

/// The stationary distribution of a Markov chain: π with π·P = π and Σπ = 1. Rows of `transition`
/// sum to 1. Returns an empty vector if it is not unique (two or more closed classes).
std::vector<double> stationary_shares(const DenseMatrix& transition);

/// The asymptotic covariance n·Cov(mean of column i, mean of column j of `functions`) of time
/// averages along a stationary Markov chain; `functions` has one row per state.
///
/// With g = (I − P + 1π)⁻¹(f − πf), the fundamental matrix's solution of Poisson's equation,
/// σ_ij = Σ_s π_s (f̃_i g_j + f̃_j g_i − f̃_i f̃_j)(s) (Kemeny & Snell, Finite Markov Chains, 1960,
/// section 4.6). It counts covariances of all lags.
DenseMatrix asymptotic_covariance(const DenseMatrix& transition,
                                  const std::vector<double>& stationary,
                                  const DenseMatrix& functions);

}  // namespace tether
