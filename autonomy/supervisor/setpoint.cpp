#include "autonomy/supervisor/setpoint.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

Twist slowed_to(const Twist& twist, const Outline& outline, double allowed_mps) {
  const double pace = pace_mps(twist, outline);
  if (pace <= allowed_mps) return twist;
  const double share = allowed_mps / pace;
  return {share * twist.v_mps, share * twist.omega_radps};
}

Twist Setpoint::step(const Twist& target, double allowed_mps, double dt_s) {
  const double pace = pace_mps(twist_, outline_);
  const bool to_rest = target.v_mps == 0.0 && target.omega_radps == 0.0;
  if (pace > allowed_mps) {
    twist_ = braked(dt_s, to_rest ? 0.0 : allowed_mps / pace);
  } else if (to_rest) {
    twist_ = braked(dt_s, 0.0);
  } else {
    twist_ = nearer(slowed_to(target, outline_, allowed_mps), allowed_mps, dt_s);
  }
  return twist_;
}

Twist Setpoint::braked(double dt_s, double least_share) const {
  const double time_s = std::max(std::abs(twist_.v_mps) / limits_.acceleration_mps2,
                                 std::abs(twist_.omega_radps) / limits_.yaw_acceleration_radps2);
  if (time_s <= dt_s && least_share == 0.0) return {};
  const double share = std::max(1.0 - dt_s / time_s, least_share);
  return {share * twist_.v_mps, share * twist_.omega_radps};
}

Twist Setpoint::nearer(const Twist& target, double allowed_mps, double dt_s) const {
  const double most_mps = limits_.acceleration_mps2 * dt_s;
  const double most_radps = limits_.yaw_acceleration_radps2 * dt_s;
  const double dv = std::clamp(target.v_mps - twist_.v_mps, -most_mps, most_mps);
  const double dw = std::clamp(target.omega_radps - twist_.omega_radps, -most_radps, most_radps);
  // Both changes by one factor where the sum would be too fast: each of the old and the target
  // alone is not, but on the way from one to the other one axis may have to wait.
  double share = 1.0;
  const auto keep_below = [&share](double from, double change, double most) {
    const double to = from + change;
    if (std::abs(to) > most && change != 0.0) {
      share = std::min(share, std::max((std::copysign(most, to) - from) / change, 0.0));
    }
  };
  keep_below(twist_.v_mps, dv, allowed_mps);
  keep_below(twist_.omega_radps, dw, allowed_mps / outline_.reach_m());
  return {twist_.v_mps + share * dv, twist_.omega_radps + share * dw};
}

}  // namespace tether
