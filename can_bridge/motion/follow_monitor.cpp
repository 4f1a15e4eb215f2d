#include "can_bridge/motion/follow_monitor.hpp"

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
  if (!wheels[0].valid || !wheels[1].valid) {
    last_.reset();
    return "";
  }
  const Sample sample{now, {wheels[0].angle_rad, wheels[1].angle_rad}};
  if (!last_) {
    last_ = sample;
    sums_ = {};
    return "";
  }
  const double dt = to_seconds(now - last_->stamp);
  const WheelSpeeds wanted = to_wheel_speeds(setpoint, track_m_);
  std::string trouble;
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    const double wanted_mps = i == 0 ? wanted.left_mps : wanted.right_mps;
    const double turned_m = (sample.angle_rad[i] - last_->angle_rad[i]) * wheel_radius_m_;
    for (std::size_t k = 0; k < kTests.size(); ++k) {
      Sums& sums = sums_[i][k];
      const double wanted_m = wanted_mps * dt;
      if (!exceeds(kTests[k], sums, wanted_m, wanted_m - turned_m, dt) || !trouble.empty())
        continue;
      trouble = fmt::format(
          "the {} wheel does not follow: told {:.2f} m/s, last reported {:.2f} m/s, {:.2f} m {} "
          "beyond what is allowed: check encoder, brake, sign and whether it is blocked",
          i == 0 ? "left" : "right", wanted_mps, wheels[i].speed_radps * wheel_radius_m_,
          std::max(sums.behind_m, sums.ahead_m),
          (sums.behind_m >= sums.ahead_m) == (wanted_mps >= 0.0) ? "behind" : "ahead");
    }
  }
  last_ = sample;
  return trouble;
}

}  // namespace tether
