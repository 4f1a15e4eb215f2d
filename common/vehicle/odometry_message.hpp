#pragma once

#include <cstdint>
#include <tether/odometry_t.hpp>

#include "common/base/time.hpp"
#include "common/vehicle/dead_reckoning.hpp"

namespace tether {

/// Odometry message at `stamp`, in the form that all publishers use.
inline odometry_t odometry_message(Instant stamp, std::int64_t seq, const DeadReckoning& wheels,
                                   const Twist& twist) {
  odometry_t message{};
  message.utime = to_utime(stamp);
  message.seq = seq;
  message.x_m = wheels.pose.x_m;
  message.y_m = wheels.pose.y_m;
  message.yaw_rad = wheels.pose.yaw_rad;
  message.v_mps = twist.v_mps;
  message.omega_radps = twist.omega_radps;
  message.distance_m = wheels.distance_m;
  message.cov_x_x_m2 = wheels.covariance.x_x;
  message.cov_x_y_m2 = wheels.covariance.x_y;
  message.cov_x_yaw_m_rad = wheels.covariance.x_yaw;
  message.cov_y_y_m2 = wheels.covariance.y_y;
  message.cov_y_yaw_m_rad = wheels.covariance.y_yaw;
  message.cov_yaw_yaw_rad2 = wheels.covariance.yaw_yaw;
  return message;
}

}  // namespace tether
