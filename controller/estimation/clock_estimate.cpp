#include "controller/estimation/clock_estimate.hpp"

#include <algorithm>

namespace tether {

void ClockEstimate::add_up(Duration up) { up_ = std::min(up_, up); }

void ClockEstimate::add_down(Duration earliest, Duration latest) {
  down_most_ = std::min(down_most_, latest);
  down_least_ = std::max(down_least_, earliest);
}

Duration ClockEstimate::offset() const {
  if (up_ == Duration::max() || down_most_ == Duration::max()) return Duration{0};
  // If delays vary, the shortest may be below what another one was at least.
  const Duration least = std::min(down_least_, down_most_);
  const double half_s = 0.25 * to_seconds(down_most_ - least);
  const double middle_s = 0.5 * to_seconds(down_most_) - half_s - 0.5 * to_seconds(up_);
  if (half_s > kWidest_s) return Duration{0};
  const double share = kPrior_s * kPrior_s / (kPrior_s * kPrior_s + half_s * half_s / 3.0);
  const Duration low = std::max(-up_, -kMost);
  const Duration high = std::max(std::min(down_most_, kMost), low);
  return std::clamp(from_seconds(share * middle_s), low, high);
}

Duration ClockEstimate::near(Duration used) const {
  const Duration estimate = offset();
  return std::chrono::abs(estimate - used) > kSame ? estimate : used;
}

}  // namespace tether
