#include "common/vehicle/motion_model.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

constexpr double kMostLead = 4.0;

}  // namespace

void MotionModel::advance(State& state, Heading& heading, const Twist& command, double dt_s) const {
  const WheelSpeeds wanted = target_of(command);
  if (drive_.lag_s > 0.0) {
    const double steps = std::max(1.0, std::ceil(dt_s / kShort_s - 1e-9));
    for (int i = 0; i < static_cast<int>(steps); ++i)
      step_with_lag(state, heading, wanted, dt_s / steps);
    return;
  }
  state.lagging = wanted;
  roll_to(state, heading, saturate(wanted, limits_.max_wheel_speed_mps), dt_s);
}

void MotionModel::roll_to(State& state, Heading& heading, const WheelSpeeds& target,
                          double dt_s) const {
  const double left_m = roll(state.rim.left_mps, target.left_mps, dt_s);
  const double right_m = roll(state.rim.right_mps, target.right_mps, dt_s);
  move(state, heading, left_m, right_m, dt_s);
}

/// How far a wheel rolls in `dt_s` on its way to `target_mps`; `speed_mps` is what it then has.
double MotionModel::roll(double& speed_mps, double target_mps, double dt_s) const {
  const double change_mps = target_mps - speed_mps;
  const double ramp_s = std::min(dt_s, std::abs(change_mps) * s_per_mps_);
  const double start_mps = speed_mps;
  const double most_mps = limits_.max_wheel_acceleration_mps2 * dt_s;
  speed_mps = ramp_s < dt_s ? target_mps : start_mps + std::copysign(most_mps, change_mps);
  return 0.5 * (start_mps + speed_mps) * ramp_s + target_mps * (dt_s - ramp_s);
}

Twist MotionModel::pursue(State& state, Heading& heading, const Twist& wish, double dt_s) const {
  if (!ideal_) {
    const Twist command = command_for(state, reachable(state.rim, wish, dt_s), dt_s);
    advance(state, heading, command, dt_s);
    return command;
  }
  const WheelSpeeds target = saturate(rim_of(wish), limits_.max_wheel_speed_mps);
  state.lagging = approach(state.rim, target, limits_.max_wheel_acceleration_mps2 * dt_s);
  roll_to(state, heading, state.lagging, dt_s);
  return to_twist(state.lagging, limits_.track_m);
}

WheelSpeeds MotionModel::target_of(const Twist& command) const {
  if (ideal_) return rim_of(command);
  const WheelSpeeds rim = rim_of({command.v_mps, command.omega_radps * drive_.turn_scale});
  return {rim.left_mps * drive_.rim_scale, rim.right_mps * drive_.rim_scale};
}

void MotionModel::step_with_lag(State& state, Heading& heading, const WheelSpeeds& target,
                                double dt_s) const {
  const double share = dt_s / (drive_.lag_s + dt_s);
  state.lagging.left_mps += share * (target.left_mps - state.lagging.left_mps);
  state.lagging.right_mps += share * (target.right_mps - state.lagging.right_mps);
  const WheelSpeeds before = state.rim;
  state.rim = approach(before, saturate(state.lagging, limits_.max_wheel_speed_mps),
                       limits_.max_wheel_acceleration_mps2 * dt_s);
  move(state, heading, 0.5 * (before.left_mps + state.rim.left_mps) * dt_s,
       0.5 * (before.right_mps + state.rim.right_mps) * dt_s, dt_s);
}

void MotionModel::move(State& state, Heading& heading, double left_m, double right_m,
                       double dt_s) const {
  double half_turn_rad = 0.5 * (right_m - left_m) * turn_per_m_;
  double arc_m = 0.5 * (left_m + right_m);
  if (!ideal_ && (left_m != 0.0 || right_m != 0.0)) {
    arc_m += drive_.v_bias_mps * dt_s;
    half_turn_rad += 0.5 * drive_.omega_bias_radps * dt_s;
  }
  // The chord of an arc is shorter by sin(h)/h of half its turn.
  const SinCos half_turn = sin_cos(half_turn_rad);
  const double chord_m = half_turn_rad != 0.0 ? arc_m * half_turn.sin / half_turn_rad : arc_m;
  const Heading middle = heading.turned(half_turn);
  state.pose.x_m += chord_m * middle.cos;
  state.pose.y_m += chord_m * middle.sin;
  state.pose.yaw_rad = wrap_angle(state.pose.yaw_rad + 2.0 * half_turn_rad);
  heading = middle.turned(half_turn);
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
