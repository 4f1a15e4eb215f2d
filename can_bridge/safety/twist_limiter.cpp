#include "can_bridge/safety/twist_limiter.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
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
