#include "can_bridge/safety/ramp_watch.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

bool RampWatch::brakes(Instant now, const Twist& setpoint, const Twist& measured) {
  // Tolerance for encoders, the floor and wheels that brake differently.
  constexpr double kStands_mps = 0.05, kStands_radps = 0.2;
  const Twist u{std::abs(measured.v_mps), std::abs(measured.omega_radps)};
  if (!since_) {
    since_ = now;
    from_ = u;
  }
  told_.emplace_back(now, setpoint);
  while (told_.size() > 1 && now - told_[1].first >= kGrace) told_.pop_front();
  const double braked_s = to_seconds(now - *since_ - kGrace);
  if (braked_s < 0.0) {
    from_ = {std::max(from_.v_mps, u.v_mps), std::max(from_.omega_radps, u.omega_radps)};
    return true;
  }
  const double v_mps = from_.v_mps - deceleration_mps2_ / 2.0 * braked_s;
  const double w_radps = from_.omega_radps - yaw_deceleration_radps2_ / 2.0 * braked_s;
  const Twist& told = told_.front().second;
  return u.v_mps <= std::max(v_mps, std::abs(told.v_mps)) + kStands_mps &&
         u.omega_radps <= std::max(w_radps, std::abs(told.omega_radps)) + kStands_radps;
}

}  // namespace tether
