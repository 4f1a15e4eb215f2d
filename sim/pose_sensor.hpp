#pragma once

#include <boost/random/normal_distribution.hpp>

#include "common/pose.hpp"
#include "common/random.hpp"
#include "common/scenario.hpp"

namespace tether {

/// Turns the true pose into a measured one: white Gaussian noise on x, y and yaw. The n-th
/// measurement's noise depends on the seed and n only (it is drawn also when it is not used).
class PoseSensor {
 public:
  PoseSensor(const Scenario::Sensor& config, RandomEngine random)
      : config_(config), random_(random) {}

  Pose2 measure(const Pose2& truth) {
    const double dx_m = config_.position_noise_m * normal_(random_);
    const double dy_m = config_.position_noise_m * normal_(random_);
    const double dyaw_rad = config_.yaw_noise_rad * normal_(random_);
    return {truth.x_m + dx_m, truth.y_m + dy_m, wrap_angle(truth.yaw_rad + dyaw_rad)};
  }

 private:
  Scenario::Sensor config_;
  RandomEngine random_;
  boost::random::normal_distribution<double> normal_;
};

}  // namespace tether
