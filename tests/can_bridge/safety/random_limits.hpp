#pragma once

#include <cmath>
#include <random>

#include "can_bridge/safety/twist_limiter.hpp"

namespace tether::test {

/// No random limit of speed or yaw rate is above this.
constexpr double kFastest = 4.0;

using Random = std::mt19937_64;

inline double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// From sluggish to brisk, with the wheels' limit within reach of the others or not.
inline TwistLimits random_limits(Random& random) {
  TwistLimits l;
  l.max_speed_mps = uniform(random, 0.2, kFastest);
  l.max_reverse_mps = uniform(random, 0.1, kFastest);
  l.max_yaw_rate_radps = uniform(random, 0.2, 3.0);
  l.max_acceleration_mps2 = std::exp(uniform(random, -2.0, 2.0));
  l.max_deceleration_mps2 = l.max_acceleration_mps2 * uniform(random, 1.0, 4.0);
  l.max_yaw_acceleration_radps2 = std::exp(uniform(random, -2.0, 2.0));
  l.max_yaw_deceleration_radps2 = l.max_yaw_acceleration_radps2 * uniform(random, 1.0, 4.0);
  l.max_jerk_mps3 = std::exp(uniform(random, -1.0, 5.0));
  l.max_yaw_jerk_radps3 = std::exp(uniform(random, -1.0, 5.0));
  l.max_wheel_speed_mps = uniform(random, 0.3, 6.0);
  l.track_m = uniform(random, 0.3, 1.5);
  l.cycle = std::chrono::milliseconds{std::uniform_int_distribution<int>(1, 50)(random)};
  return l;
}

}  // namespace tether::test
