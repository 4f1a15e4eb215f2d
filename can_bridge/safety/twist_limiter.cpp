#include "can_bridge/safety/twist_limiter.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

/// rate + (rate − step) + (rate − 2·step) + … over the positive terms.
double staircase_sum(double rate, double step) {
  if (rate <= 0.0) return 0.0;
  const double n = std::max(0.0, std::ceil(rate / step) - 1.0);
  return (n + 1.0) * rate - step * n * (n + 1.0) / 2.0;
}

/// Inverse of staircase_sum: with n terms, sum = n·rate − step·n(n−1)/2, of which n is the smallest
/// number with sum ≤ step·n(n+1)/2.
double staircase_top(double sum, double step) {
  if (sum <= 0.0 || step <= 0.0) return 0.0;
  const double n = std::max(1.0, std::ceil((std::sqrt(1.0 + 8.0 * sum / step) - 1.0) / 2.0));
  return sum / n + step * (n - 1.0) / 2.0;
}

/// The largest rate towards zero that can be taken back, step by step, to `away` before zero is
/// crossed. Zero is `distance` away (in rates · cycle). A staircase with n terms from `away` on
/// covers n·away + step·n(n−1)/2; n is the largest number for which that is < distance.
double crossing_rate(double distance, double away, double step) {
  const double b = away - step / 2.0;
  const double n = std::ceil((std::sqrt(b * b + 2.0 * step * distance) - b) / step) - 1.0;
  if (n < 1.0) return away;
  return std::min(away + n * step, distance / n + step * (n - 1.0) / 2.0);
}

}  // namespace

AxisRamp::AxisRamp(const Limits& limits, double cycle_s)
    : limits_(limits),
      cycle_s_(cycle_s),
      step_(limits.jerk * cycle_s),
      stop_step_(limits.stop_jerk * cycle_s) {
  assert(cycle_s > 0.0);
  assert(limits.acceleration > 0.0 && limits.jerk > 0.0);
  assert(limits.deceleration >= limits.acceleration);
  assert(limits.stop_jerk >= limits.jerk);
}

void AxisRamp::reset(double value) {
  value_ = value;
  rate_ = 0.0;
  releasing_ = false;
}

AxisRamp::Share AxisRamp::limits_towards(double target, bool stopping) const {
  const double step = stopping ? stop_step_ : step_;
  const bool slowing = (target - value_) * value_ < 0.0;
  if (!slowing) return {limits_.acceleration, step};
  if (target * value_ >= 0.0) return {limits_.deceleration, step};
  const double crossing = crossing_rate(std::abs(value_) / cycle_s_, limits_.acceleration, step_);
  return {std::min(limits_.deceleration, crossing), step};
}

void AxisRamp::step(double target, const Share& share, bool stopping) {
  if (stopping) releasing_ = true;
  const double step = stopping ? stop_step_ : step_;
  const double difference = target - value_;
  double sign = rate_ > 0.0 ? -1.0 : 1.0;
  if (difference != 0.0) sign = difference > 0.0 ? 1.0 : -1.0;

  const double towards = sign * rate_;  // negative: it moves away from the target
  const double wanted = std::min(
      share.rate, staircase_top(std::abs(difference) / cycle_s_, std::min(step, share.rate_step)));
  double lowest = 0.0, highest = 0.0;
  if (towards < 0.0) {
    lowest = towards;
    highest = std::min(towards + release_step(), std::max(0.0, towards + step));
  } else {
    lowest = std::max(towards - release_step(), std::min(0.0, towards - step));
    highest = towards + std::min(step, share.rate_step);
  }
  rate_ = sign * std::clamp(wanted, lowest, highest);
  value_ += rate_ * cycle_s_;
  // The last step lands on the target but for rounding, which must not start another approach.
  if (std::abs(target - value_) <= 1e-12 * std::max(1.0, std::abs(target))) value_ = target;
  if (!stopping && std::abs(rate_) <= step_) releasing_ = false;
}

double AxisRamp::resting_value() const {
  const double step = release_step();
  return value_ + std::copysign(cycle_s_ * staircase_sum(std::abs(rate_) - step, step), rate_);
}

double AxisRamp::occupied() const { return std::max(std::abs(value_), std::abs(resting_value())); }

namespace {

AxisRamp::Limits axis_limits(double acceleration, double deceleration, double jerk) {
  const double punctual =
      (1.5 * acceleration + deceleration) / to_seconds(TwistLimiter::kStopJerkDelay);
  return {acceleration, deceleration, jerk, std::max(jerk, punctual)};
}

bool slows(double speed, double target) { return (target - speed) * speed < 0.0; }

/// The factor by which a speed has to be scaled to stay within its limit.
double scale_to(double limit, double speed) { return speed > limit ? limit / speed : 1.0; }

}  // namespace

TwistLimits twist_limits(const Sections<VehicleSettings, CanSettings>& settings) {
  const CanSettings& can = settings.get<CanSettings>();
  TwistLimits limits;
  limits.max_speed_mps = can.max_speed_mps;
  limits.max_reverse_mps = can.max_reverse_mps;
  limits.max_yaw_rate_radps = can.max_yaw_rate_radps;
  limits.max_acceleration_mps2 = can.max_acceleration_mps2;
  limits.max_deceleration_mps2 = can.max_deceleration_mps2;
  limits.max_yaw_acceleration_radps2 = can.max_yaw_acceleration_radps2;
  limits.max_yaw_deceleration_radps2 = can.max_yaw_deceleration_radps2;
  limits.max_jerk_mps3 = can.max_jerk_mps3;
  limits.max_yaw_jerk_radps3 = can.max_yaw_jerk_radps3;
  limits.max_wheel_speed_mps = settings.get<VehicleSettings>().max_wheel_speed_mps;
  limits.track_m = settings.get<VehicleSettings>().track_m;
  limits.cycle = from_seconds(can.cycle_ms * 1e-3);
  return limits;
}

TwistLimiter::TwistLimiter(const TwistLimits& limits)
    : limits_(limits),
      half_track_m_(limits.track_m / 2.0),
      v_(axis_limits(limits.max_acceleration_mps2, limits.max_deceleration_mps2,
                     limits.max_jerk_mps3),
         to_seconds(limits.cycle)),
      omega_(axis_limits(limits.max_yaw_acceleration_radps2, limits.max_yaw_deceleration_radps2,
                         limits.max_yaw_jerk_radps3),
             to_seconds(limits.cycle)) {
  assert(limits.max_speed_mps > 0.0 && limits.max_reverse_mps > 0.0);
  assert(limits.max_yaw_rate_radps > 0.0 && limits.max_wheel_speed_mps > 0.0);
  assert(limits.track_m > 0.0);
}

void TwistLimiter::reset() {
  v_.reset(0.0);
  omega_.reset(0.0);
}

Twist TwistLimiter::step(const Twist& target) {
  return advance(within_speed_limits(target), false);
}

Twist TwistLimiter::brake_to(const Twist& target) {
  return advance(within_speed_limits(target), true);
}

Twist TwistLimiter::stop() { return advance({}, true); }

bool TwistLimiter::at_rest() const {
  return v_.value() == 0.0 && v_.rate() == 0.0 && omega_.value() == 0.0 && omega_.rate() == 0.0;
}

Twist TwistLimiter::within_speed_limits(const Twist& target) const {
  const double max_v = target.v_mps < 0.0 ? limits_.max_reverse_mps : limits_.max_speed_mps;
  const WheelSpeeds wheels = to_wheel_speeds(target, limits_.track_m);
  const double fastest = std::max(std::abs(wheels.left_mps), std::abs(wheels.right_mps));
  const double scale = std::min({scale_to(max_v, std::abs(target.v_mps)),
                                 scale_to(limits_.max_yaw_rate_radps, std::abs(target.omega_radps)),
                                 scale_to(limits_.max_wheel_speed_mps, fastest)});
  return {target.v_mps * scale, target.omega_radps * scale};
}

Twist TwistLimiter::advance(const Twist& target, bool stopping) {
  const double dv = std::abs(target.v_mps - v_.value());
  const double dw = std::abs(target.omega_radps - omega_.value());
  const AxisRamp::Share v = v_.limits_towards(target.v_mps, stopping);
  const AxisRamp::Share w = omega_.limits_towards(target.omega_radps, stopping);
  AxisRamp::Share v_share = v, w_share = w;
  if (dv > 0.0 && dw > 0.0) {
    const double rate = std::min(v.rate / dv, w.rate / dw);
    const double step = std::min(v.rate_step / dv, w.rate_step / dw);
    const bool v_slows = slows(v_.value(), target.v_mps);
    if (!v_slows) v_share = {rate * dv, step * dv};
    if (v_slows || !slows(omega_.value(), target.omega_radps)) w_share = {rate * dw, step * dw};
  }
  // Each axis may use what the other leaves of the wheels' speed: |v| + |ω|·track/2 ≤ maximum.
  const double w_room = std::max(0.0, limits_.max_wheel_speed_mps - v_.occupied()) / half_track_m_;
  omega_.step(std::clamp(target.omega_radps, -w_room, w_room), w_share, stopping);
  const double v_room =
      std::max(0.0, limits_.max_wheel_speed_mps - omega_.occupied() * half_track_m_);
  v_.step(std::clamp(target.v_mps, -v_room, v_room), v_share, stopping);
  return twist();
}

}  // namespace tether
