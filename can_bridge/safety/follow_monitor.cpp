#include "can_bridge/safety/follow_monitor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tether {

bool FollowMonitor::exceeds(const Test& test, Sums& sums, double wanted_m, double behind_m,
                            double dt) {
  const double allowed_m = test.allowed_mps * dt + test.allowed_share * std::abs(wanted_m);
  sums.behind_m = std::max(0.0, sums.behind_m + behind_m - allowed_m);
  sums.ahead_m = std::max(0.0, sums.ahead_m - behind_m - allowed_m);
  return std::max(sums.behind_m, sums.ahead_m) >= test.limit_m;
}

std::string FollowMonitor::update(Instant now, const Twist& setpoint,
                                  const std::array<WheelFeedback, 2>& wheels) {
  if (sampler_.begins()) sums_ = {};
  const auto ways = sampler_.update(now, setpoint, wheels);
  if (!ways) return "";
  std::string trouble;
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    const RimWays& w = (*ways)[i];
    for (std::size_t k = 0; k < kTests.size(); ++k) {
      Sums& sums = sums_[i][k];
      const double behind_m = w.told_m - w.counted_m;
      if (!exceeds(kTests[k], sums, w.told_m, behind_m, w.dt_s) || !trouble.empty()) continue;
      trouble = fmt::format(
          "the {} wheel does not follow: told {:.2f} m/s, last reported {:.2f} m/s, {:.2f} m {} "
          "beyond what is allowed: check encoder, brake, sign and whether it is blocked",
          side_name(i), w.told_mps, wheels[i].speed_radps * wheel_radius_m_,
          std::max(sums.behind_m, sums.ahead_m),
          (sums.behind_m >= sums.ahead_m) == (w.told_mps >= 0.0) ? "behind" : "ahead");
    }
  }
  return trouble;
}

}  // namespace tether
