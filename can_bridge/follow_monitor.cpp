#include "can_bridge/follow_monitor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tether {

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
    const double behind_m = wanted_mps * dt - turned_m;
    const double allowed_m = (kAllowed_mps + kAllowedShare * std::abs(wanted_mps)) * dt;
    Sums& sums = sums_[i];
    sums.behind_m = std::max(0.0, sums.behind_m + behind_m - allowed_m);
    sums.ahead_m = std::max(0.0, sums.ahead_m - behind_m - allowed_m);
    const double worst_m = std::max(sums.behind_m, sums.ahead_m);
    if (trouble.empty() && worst_m >= kLimit_m) {
      trouble = fmt::format(
          "the {} wheel does not follow: told {:.2f} m/s, last reported {:.2f} m/s, {:.2f} m {} "
          "beyond what is allowed: check encoder, brake, sign and whether it is blocked",
          i == 0 ? "left" : "right", wanted_mps, wheels[i].speed_radps * wheel_radius_m_, worst_m,
          (sums.behind_m >= sums.ahead_m) == (wanted_mps >= 0.0) ? "behind" : "ahead");
    }
  }
  last_ = sample;
  return trouble;
}

}  // namespace tether
