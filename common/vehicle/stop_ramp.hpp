#pragma once

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// How a vehicle that gets no more commands comes to a stop. All > 0.
struct StopLimits {
  double deceleration_mps2 = 1.5;
  double yaw_deceleration_radps2 = 3.0;
  double max_wheel_acceleration_mps2 = 3.0;  ///< limit of each rim
  double max_wheel_speed_mps = 10.0;         ///< limit of each rim
  double track_m = 1.2;
};

/// `twist` as far as the wheels can turn: both scaled by one factor.
Twist within_wheel_speed(const Twist& twist, const StopLimits& limits);

/// The twist `since` (≥ 0) after the ramp to a stop began at `from` (finite): v and ω shrink by one
/// factor, linearly in time, so that the vehicle stays on its curve, and no faster than the
/// tightest of the limits allows. Zero after max(|v|/deceleration, |ω|/yaw deceleration, faster
/// rim/wheel acceleration) of what the wheels can turn.
Twist ramp_to_stop(const Twist& from, Duration since, const StopLimits& limits);

}  // namespace tether
