#include "common/vehicle/motion_model.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

/// How far a wheel rolls in `dt_s` on its way to `target_mps`; `speed_mps` is what it then has.
double roll(double& speed_mps, double target_mps, double acceleration_mps2, double dt_s) {
  const double change_mps = target_mps - speed_mps;
  const double ramp_s = std::min(dt_s, std::abs(change_mps) / acceleration_mps2);
  const double start_mps = speed_mps;
  speed_mps =
      ramp_s < dt_s ? target_mps : start_mps + std::copysign(acceleration_mps2 * dt_s, change_mps);
  return 0.5 * (start_mps + speed_mps) * ramp_s + target_mps * (dt_s - ramp_s);
}

}  // namespace

void MotionModel::advance(State& state, const Twist& command, double dt_s) const {
  const WheelSpeeds target = saturate(rim_of(command), limits_.max_wheel_speed_mps);
  const double a = limits_.max_wheel_acceleration_mps2;
  const double left_m = roll(state.rim.left_mps, target.left_mps, a, dt_s);
  const double right_m = roll(state.rim.right_mps, target.right_mps, a, dt_s);
  const double half_turn_rad = 0.5 * (right_m - left_m) / limits_.track_m;
  // The chord of an arc is shorter by sin(h)/h of half its turn; the series is within 1e-9 of it
  // up to a turn of 0.3 rad, which only larger steps exceed.
  const double h2 = half_turn_rad * half_turn_rad;
  const double shorter =
      h2 < 0.0225 ? 1.0 - h2 / 6.0 * (1.0 - h2 / 20.0) : std::sin(half_turn_rad) / half_turn_rad;
  const double chord_m = 0.5 * (left_m + right_m) * shorter;
  const double heading_rad = state.pose.yaw_rad + half_turn_rad;
  state.pose.x_m += chord_m * std::cos(heading_rad);
  state.pose.y_m += chord_m * std::sin(heading_rad);
  state.pose.yaw_rad = wrap_angle(heading_rad + half_turn_rad);
}

Twist MotionModel::reachable(const WheelSpeeds& rim, const Twist& command, double dt_s) const {
  const WheelSpeeds target = saturate(rim_of(command), limits_.max_wheel_speed_mps);
  return to_twist(approach(rim, target, limits_.max_wheel_acceleration_mps2 * dt_s),
                  limits_.track_m);
}

}  // namespace tether
