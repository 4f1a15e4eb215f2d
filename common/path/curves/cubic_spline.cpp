#include "common/path/curves/cubic_spline.hpp"

#include <cassert>
#include <utility>

namespace tether {
namespace {

using Numbers = std::vector<double>;

/// Solves a tridiagonal system with a dominant diagonal (Thomas). Row i is below[i] x[i-1] +
/// diagonal[i] x[i] + above[i] x[i+1] = right[i]; below[0] and above[n-1] are ignored.
Numbers solve(const Numbers& below, Numbers diagonal, const Numbers& above, Numbers right) {
  const std::size_t n = diagonal.size();
  for (std::size_t i = 1; i < n; ++i) {
    const double factor = below[i] / diagonal[i - 1];
    diagonal[i] -= factor * above[i - 1];
    right[i] -= factor * right[i - 1];
  }
  for (std::size_t i = n; i-- > 0;) {
    if (i + 1 < n) right[i] -= above[i] * right[i + 1];
    right[i] /= diagonal[i];
  }
  return right;
}

/// The same for a ring: below[0] is x[n-1]'s factor, above[n-1] is x[0]'s (Sherman-Morrison).
Numbers solve_ring(const Numbers& below, Numbers diagonal, const Numbers& above,
                   const Numbers& right) {
  const std::size_t last = diagonal.size() - 1;
  const double gamma = -diagonal[0];
  Numbers edge(diagonal.size(), 0.0);
  edge[0] = gamma;
  edge[last] = above[last];
  diagonal[last] -= above[last] * below[0] / gamma;
  diagonal[0] -= gamma;
  Numbers x = solve(below, diagonal, above, right);
  const Numbers z = solve(below, diagonal, above, edge);
  const double share = below[0] / gamma;
  const double factor = (x[0] + share * x[last]) / (1.0 + z[0] + share * z[last]);
  for (std::size_t i = 0; i <= last; ++i) x[i] -= factor * z[i];
  return x;
}

}  // namespace

CubicSpline::CubicSpline(Numbers u, Numbers y, Ends ends) : u_(std::move(u)), y_(std::move(y)) {
  const bool is_ring = ends == Ends::periodic;
  const std::size_t segments = u_.size() - 1;
  assert(y_.size() == u_.size() && segments >= (is_ring ? 3U : 1U));
  second_.assign(u_.size(), 0.0);
  // One row for each point with a segment on both sides: of a ring, each but the last.
  Numbers below, diagonal, above, right;
  for (std::size_t k = is_ring ? 0 : 1; k < segments; ++k) {
    const std::size_t before = k == 0 ? segments - 1 : k - 1;
    const double h = u_[before + 1] - u_[before], next = u_[k + 1] - u_[k];
    below.push_back(h / 6.0);
    diagonal.push_back((h + next) / 3.0);
    above.push_back(next / 6.0);
    right.push_back((y_[k + 1] - y_[k]) / next - (y_[before + 1] - y_[before]) / h);
  }
  if (diagonal.empty()) return;
  const Numbers x =
      is_ring ? solve_ring(below, diagonal, above, right) : solve(below, diagonal, above, right);
  for (std::size_t i = 0; i < x.size(); ++i) second_[i + (is_ring ? 0 : 1)] = x[i];
  if (is_ring) second_.back() = second_.front();
}

CubicSpline::Value CubicSpline::at(std::size_t segment, double u) const {
  const std::size_t k = segment;
  const double h = u_[k + 1] - u_[k];
  const double b = (u - u_[k]) / h, a = 1.0 - b;
  const double slope = (y_[k + 1] - y_[k]) / h;
  return {
      a * y_[k] + b * y_[k + 1] +
          ((a * a * a - a) * second_[k] + (b * b * b - b) * second_[k + 1]) * h * h / 6.0,
      slope + ((1.0 - 3.0 * a * a) * second_[k] + (3.0 * b * b - 1.0) * second_[k + 1]) * h / 6.0,
      a * second_[k] + b * second_[k + 1]};
}

}  // namespace tether
