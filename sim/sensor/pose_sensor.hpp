#pragma once

#include <boost/random/normal_distribution.hpp>
#include <cmath>
#include <utility>

#include "common/base/random.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/pose.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {

/// Turns the true pose into a measured one: white Gaussian noise on x, y and yaw, and a random walk
/// of each. Odometry without a reference drifts like that; here the walk begins at 0 with the first
/// measurement. The n-th measurement's errors depend on the seed and n only (they are drawn also
/// when they are not used).
class PoseSensor {
 public:
  PoseSensor(const SensorSettings& config, RandomEngine noise, RandomEngine drift)
      : config_(config), random_(noise), drift_random_(drift) {}

  Pose2 measure(const Pose2& truth) {
    walk();
    const double dx_m = config_.position_noise_m * normal_(random_);
    const double dy_m = config_.position_noise_m * normal_(random_);
    const double dyaw_rad = config_.yaw_noise_rad * normal_(random_);
    return {truth.x_m + drift_.x_m + dx_m, truth.y_m + drift_.y_m + dy_m,
            wrap_angle(truth.yaw_rad + drift_.yaw_rad + dyaw_rad)};
  }

 private:
  void walk() {
    if (std::exchange(first_, false)) return;
    const double root_s = std::sqrt(1.0 / config_.rate_hz);
    drift_.x_m += config_.position_drift_mpsqrts * root_s * drift_normal_(drift_random_);
    drift_.y_m += config_.position_drift_mpsqrts * root_s * drift_normal_(drift_random_);
    drift_.yaw_rad += config_.yaw_drift_radpsqrts * root_s * drift_normal_(drift_random_);
  }

  SensorSettings config_;
  RandomEngine random_;
  boost::random::normal_distribution<double> normal_;
  RandomEngine drift_random_;
  boost::random::normal_distribution<double> drift_normal_;
  Pose2 drift_;
  bool first_ = true;
};

}  // namespace tether
