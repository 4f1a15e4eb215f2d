#include "netem/statistics/stationary.hpp"

#include <algorithm>
#include <cstddef>

namespace tether {
namespace {

/// Which states can be reached from which, in any number of moves, none included.
std::vector<std::vector<bool>> reachable(const Matrix& moves) {
  const std::size_t n = moves.size();
  std::vector<std::vector<bool>> reach(n, std::vector<bool>(n));
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) reach[i][j] = i == j || moves[i][j] > 0.0;
  }
  for (std::size_t via = 0; via < n; ++via) {
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        if (reach[i][via] && reach[via][j]) reach[i][j] = true;
      }
    }
  }
  return reach;
}

/// The states that every state leads to, which are never left together; empty if there are none.
std::vector<std::size_t> closed_class(const Matrix& moves) {
  const auto reach = reachable(moves);
  std::vector<std::size_t> members;
  for (std::size_t j = 0; j < moves.size(); ++j) {
    if (std::all_of(reach.begin(), reach.end(), [j](const auto& row) { return row[j]; })) {
      members.push_back(j);
    }
  }
  return members;
}

}  // namespace

std::optional<std::vector<double>> stationary_distribution(const Matrix& moves) {
  const std::vector<std::size_t> members = closed_class(moves);
  if (members.empty()) return std::nullopt;
  const std::size_t n = members.size();
  Matrix a(n, std::vector<double>(n));
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) a[i][j] = moves[members[i]][members[j]];
  }
  // Take out one state after the other, from the last: its moves pass to those that remain.
  for (std::size_t k = n - 1; k > 0; --k) {
    double out = 0.0;
    for (std::size_t j = 0; j < k; ++j) out += a[k][j];
    for (std::size_t i = 0; i < k; ++i) {
      a[i][k] /= out;
      for (std::size_t j = 0; j < k; ++j) a[i][j] += a[i][k] * a[k][j];
    }
  }
  std::vector<double> weight(n, 1.0);
  double total = 1.0;
  for (std::size_t k = 1; k < n; ++k) {
    weight[k] = 0.0;
    for (std::size_t i = 0; i < k; ++i) weight[k] += weight[i] * a[i][k];
    total += weight[k];
  }
  std::vector<double> share(moves.size(), 0.0);
  for (std::size_t k = 0; k < n; ++k) share[members[k]] = weight[k] / total;
  return share;
}

}  // namespace tether
