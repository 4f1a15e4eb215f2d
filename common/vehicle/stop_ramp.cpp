#include "common/vehicle/stop_ramp.hpp"

#include <algorithm>
#include <cmath>

#include "common/vehicle/diff_drive.hpp"

namespace tether {
namespace {

double fastest_rim_mps(const Twist& twist, const StopLimits& limits) {
  const WheelSpeeds rims = to_wheel_speeds(twist, limits.track_m);
  return std::max(std::abs(rims.left_mps), std::abs(rims.right_mps));
}

}  // namespace

Twist within_wheel_speed(const Twist& twist, const StopLimits& limits) {
  const double fastest_mps = fastest_rim_mps(twist, limits);
  if (fastest_mps <= limits.max_wheel_speed_mps) return twist;
  const double scale = limits.max_wheel_speed_mps / fastest_mps;
  return {twist.v_mps * scale, twist.omega_radps * scale};
}

Twist ramp_to_stop(const Twist& from, Duration since, const StopLimits& limits) {
  const Twist begin = within_wheel_speed(from, limits);
  const double length_s =
      std::max({std::abs(begin.v_mps) / limits.deceleration_mps2,
                std::abs(begin.omega_radps) / limits.yaw_deceleration_radps2,
                fastest_rim_mps(begin, limits) / limits.max_wheel_acceleration_mps2});
  const double since_s = to_seconds(since);
  if (since_s >= length_s) return {};
  const double share = 1.0 - since_s / length_s;
  return {begin.v_mps * share, begin.omega_radps * share};
}

}  // namespace tether
