#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <vector>

namespace tether {

/// Two costs of a choice: less is better of both.
struct Tradeoff {
  double x = 0.0;
  double y = 0.0;
};

/// The numbers of those that no other one beats, by ascending x: none has less of one without more
/// of the other. Of several that are equal all are in it. Those with a NaN are not, and beat none.
inline std::vector<std::size_t> pareto_front(const std::vector<Tradeoff>& all) {
  std::vector<std::size_t> order(all.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::erase_if(order, [&](std::size_t i) { return std::isnan(all[i].x) || std::isnan(all[i].y); });
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return all[a].x != all[b].x ? all[a].x < all[b].x : all[a].y < all[b].y;
  });
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    const bool is_less = front.empty() || all[i].y < all[front.back()].y;
    const bool is_equal =
        !front.empty() && all[i].y == all[front.back()].y && all[i].x == all[front.back()].x;
    if (is_less || is_equal) front.push_back(i);
  }
  return front;
}

}  // namespace tether
