#include "common/vehicle/motion_model.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

constexpr double kMostLead = 4.0;

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
  const WheelSpeeds wanted = target_of(command);
  if (drive_.lag_s > 0.0) {
    const double steps = std::max(1.0, std::ceil(dt_s / kShort_s - 1e-9));
    for (int i = 0; i < static_cast<int>(steps); ++i) step_with_lag(state, wanted, dt_s / steps);
    return;
  }
  state.lagging = wanted;
  const WheelSpeeds target = saturate(wanted, limits_.max_wheel_speed_mps);
  const double a = limits_.max_wheel_acceleration_mps2;
  const double left_m = roll(state.rim.left_mps, target.left_mps, a, dt_s);
  const double right_m = roll(state.rim.right_mps, target.right_mps, a, dt_s);
  move(state, left_m, right_m, dt_s);
}

WheelSpeeds MotionModel::target_of(const Twist& command) const {
  if (ideal_) return rim_of(command);
  const WheelSpeeds rim = rim_of({command.v_mps, command.omega_radps * drive_.turn_scale});
  return {rim.left_mps * drive_.rim_scale, rim.right_mps * drive_.rim_scale};
}

void MotionModel::step_with_lag(State& state, const WheelSpeeds& target, double dt_s) const {
  const double share = dt_s / (drive_.lag_s + dt_s);
  state.lagging.left_mps += share * (target.left_mps - state.lagging.left_mps);
  state.lagging.right_mps += share * (target.right_mps - state.lagging.right_mps);
  const WheelSpeeds before = state.rim;
  state.rim = approach(before, saturate(state.lagging, limits_.max_wheel_speed_mps),
                       limits_.max_wheel_acceleration_mps2 * dt_s);
  move(state, 0.5 * (before.left_mps + state.rim.left_mps) * dt_s,
       0.5 * (before.right_mps + state.rim.right_mps) * dt_s, dt_s);
}

void MotionModel::move(State& state, double left_m, double right_m, double dt_s) const {
  double half_turn_rad = 0.5 * (right_m - left_m) / limits_.track_m;
  double arc_m = 0.5 * (left_m + right_m);
  if (!ideal_ && (left_m != 0.0 || right_m != 0.0)) {
    arc_m += drive_.v_bias_mps * dt_s;
    half_turn_rad += 0.5 * drive_.omega_bias_radps * dt_s;
  }
  // The chord of an arc is shorter by sin(h)/h of half its turn; the series is within 1e-9 of it
  // up to a turn of 0.3 rad, which only larger steps exceed.
  const double h2 = half_turn_rad * half_turn_rad;
  const double shorter =
      h2 < 0.0225 ? 1.0 - h2 / 6.0 * (1.0 - h2 / 20.0) : std::sin(half_turn_rad) / half_turn_rad;
  const double chord_m = arc_m * shorter;
  const double heading_rad = state.pose.yaw_rad + half_turn_rad;
  state.pose.x_m += chord_m * std::cos(heading_rad);
  state.pose.y_m += chord_m * std::sin(heading_rad);
  state.pose.yaw_rad = wrap_angle(heading_rad + half_turn_rad);
}

Twist MotionModel::command_for(const State& state, const Twist& wish, double dt_s) const {
  if (ideal_) return wish;
  WheelSpeeds rim =
      rim_of({wish.v_mps - drive_.v_bias_mps, wish.omega_radps - drive_.omega_bias_radps});
  if (drive_.lag_s > 0.0) {
    const double steps = std::max(1.0, std::ceil(dt_s / kShort_s - 1e-9));
    const double h_s = dt_s / steps;
    const double kept = std::pow(drive_.lag_s / (drive_.lag_s + h_s), steps);
    const double lead = std::min(1.0 / (1.0 - kept), kMostLead);
    rim.left_mps = state.lagging.left_mps + lead * (rim.left_mps - state.lagging.left_mps);
    rim.right_mps = state.lagging.right_mps + lead * (rim.right_mps - state.lagging.right_mps);
  }
  const Twist command = to_twist(rim, limits_.track_m);
  return {command.v_mps / drive_.rim_scale,
          command.omega_radps / (drive_.rim_scale * drive_.turn_scale)};
}

Twist MotionModel::reachable(const WheelSpeeds& rim, const Twist& command, double dt_s) const {
  const WheelSpeeds target = saturate(rim_of(command), limits_.max_wheel_speed_mps);
  return to_twist(approach(rim, target, limits_.max_wheel_acceleration_mps2 * dt_s),
                  limits_.track_m);
}

}  // namespace tether
