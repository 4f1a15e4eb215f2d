#include "tests/netem/link/loss_statistics.hpp"

#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace tether {
namespace {

std::vector<double> times(const Matrix& m, const std::vector<double>& x) {
  std::vector<double> y;
  for (const auto& row : m) {
    y.push_back(std::inner_product(row.begin(), row.end(), x.begin(), 0.0));
  }
  return y;
}

/// Solves a x = b by Gaussian elimination with row exchange; `a` is regular.
std::vector<double> solve(Matrix a, std::vector<double> b) {
  const std::size_t n = b.size();
  for (std::size_t k = 0; k < n; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < n; ++i) {
      if (std::abs(a[i][k]) > std::abs(a[pivot][k])) pivot = i;
    }
    std::swap(a[k], a[pivot]);
    std::swap(b[k], b[pivot]);
    for (std::size_t i = k + 1; i < n; ++i) {
      const double factor = a[i][k] / a[k][k];
      for (std::size_t j = k; j < n; ++j) a[i][j] -= factor * a[k][j];
      b[i] -= factor * b[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t j = k + 1; j < n; ++j) b[k] -= a[k][j] * b[j];
    b[k] /= a[k][k];
  }
  return b;
}

}  // namespace

LossStatistics::LossStatistics(Matrix steps, std::vector<double> loss, std::vector<double> share)
    : steps_(std::move(steps)), loss_(std::move(loss)), share_(std::move(share)) {
  const std::size_t n = loss_.size();
  loss_ratio_ = std::inner_product(share_.begin(), share_.end(), loss_.begin(), 0.0);
  const double variance = loss_ratio_ * (1.0 - loss_ratio_);
  if (variance <= 0.0) return;
  // Poisson's equation: g = Σ_{k ≥ 0} M^k (e − P) solves (I − M + 1 πᵀ) g = e − P.
  Matrix a(n, std::vector<double>(n));
  std::vector<double> excess(n);
  for (std::size_t i = 0; i < n; ++i) {
    excess[i] = loss_[i] - loss_ratio_;
    for (std::size_t j = 0; j < n; ++j) a[i][j] = (i == j ? 1.0 : 0.0) - steps_[i][j] + share_[j];
  }
  const std::vector<double> g = solve(std::move(a), excess);
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i) sum += share_[i] * loss_[i] * (g[i] - excess[i]);
  variance_inflation_ = 1.0 + 2.0 * sum / variance;
}

std::optional<LossStatistics> LossStatistics::of_chain(const Matrix& steps,
                                                       std::vector<double> loss) {
  auto share = stationary_distribution(steps);
  if (!share) return std::nullopt;
  return LossStatistics(steps, std::move(loss), *std::move(share));
}

std::optional<LossStatistics> LossStatistics::of(const GilbertElliott& model) {
  return of_chain(step_matrix(model), {model.one_minus_k, model.one_minus_h});
}

std::optional<LossStatistics> LossStatistics::of(const FourState& model) {
  return of_chain(step_matrix(model), {0.0, 0.0, 1.0, 1.0});
}

double LossStatistics::autocovariance(int lag) const {
  std::vector<double> later = loss_;
  for (int k = 0; k < lag; ++k) later = times(steps_, later);
  double both = 0.0;
  for (std::size_t i = 0; i < loss_.size(); ++i) both += share_[i] * loss_[i] * later[i];
  return both - loss_ratio_ * loss_ratio_;
}

double LossStatistics::mean_burst() const {
  if (loss_ratio_ <= 0.0) return 0.0;
  const double ends = loss_ratio_ - (autocovariance(1) + loss_ratio_ * loss_ratio_);
  return ends > 0.0 ? loss_ratio_ / ends : std::numeric_limits<double>::infinity();
}

double LossStatistics::loss_ratio_sd(double packets) const {
  return std::sqrt(loss_ratio_ * (1.0 - loss_ratio_) * variance_inflation_ / packets);
}

Matrix step_matrix(const GilbertElliott& m) { return {{1.0 - m.p, m.p}, {m.r, 1.0 - m.r}}; }

Matrix step_matrix(const FourState& m) {
  return {{1.0 - m.p13 - m.p14, 0.0, m.p13, m.p14},
          {0.0, 1.0 - m.p23, m.p23, 0.0},
          {m.p31, m.p32, 1.0 - m.p31 - m.p32, 0.0},
          {1.0, 0.0, 0.0, 0.0}};
}

}  // namespace tether
