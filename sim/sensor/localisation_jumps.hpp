#pragma once

#include <boost/random/exponential_distribution.hpp>
#include <boost/random/normal_distribution.hpp>
#include <limits>

#include "common/base/random.hpp"
#include "common/vehicle/pose.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {

/// Errors of a localisation that takes another place for the right one. Jumps come as a Poisson
/// process in time (sensor.jumps_per_min, from the first measurement on). Each replaces the error
/// before by a new one, normal with sensor.jump_m in x and y and sensor.jump_rad in yaw, which
/// holds until the next jump, or for sensor.jump_s if that comes first.
class LocalisationJumps {
 public:
  LocalisationJumps(const SensorSettings& config, RandomEngine random)
      : config_(config), random_(random), next_s_(config.jumps_per_min > 0.0 ? wait_s() : kNever) {}

  /// The error of the measurement at `t_s` seconds after the first; times must not decrease.
  Pose2 at(double t_s) {
    while (next_s_ <= t_s) {
      error_.x_m = config_.jump_m * normal_(random_);
      error_.y_m = config_.jump_m * normal_(random_);
      error_.yaw_rad = config_.jump_rad * normal_(random_);
      end_s_ = config_.jump_s > 0.0 ? next_s_ + config_.jump_s : kNever;
      next_s_ += wait_s();
    }
    return t_s < end_s_ ? error_ : Pose2{};
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  double wait_s() {
    return 60.0 / config_.jumps_per_min *
           boost::random::exponential_distribution<double>()(random_);
  }

  SensorSettings config_;
  RandomEngine random_;
  boost::random::normal_distribution<double> normal_;
  Pose2 error_;
  double next_s_;  ///< the next jump
  double end_s_ = 0.0;
};

}  // namespace tether
