#pragma once

#include <cmath>

#include "common/vehicle/dead_reckoning.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// Where the vehicle takes itself to be by its wheels' encoders alone: dead reckoning from its
/// nominal start, with the radius and the track that it believes in. So vehicle.radius_error,
/// vehicle.track_error, slip and an uncertain start show as errors that it knows nothing of; its
/// covariance grows as that of the CAN bridge (can_bridge/safety/odometry.hpp), which takes radius
/// and track to be calibrated.
class WheelOdometry {
 public:
  explicit WheelOdometry(const VehicleSettings& vehicle)
      : radius_m_(vehicle.wheel_radius_m / (1.0 + vehicle.radius_error)),
        track_m_(vehicle.track_m * (1.0 + vehicle.track_error)),
        radius_ratio_(1.0 + vehicle.radius_error) {
    state_.pose = {vehicle.start_x_m, vehicle.start_y_m, wrap_angle(vehicle.start_yaw_rad)};
  }

  /// The encoders' angles since the start.
  void update(double left_angle_rad, double right_angle_rad) {
    const double left_m = (left_angle_rad - left_angle_rad_) * radius_m_;
    const double right_m = (right_angle_rad - right_angle_rad_) * radius_m_;
    left_angle_rad_ = left_angle_rad;
    right_angle_rad_ = right_angle_rad;
    constexpr double kVariance_m = DeadReckoning::kVariancePerMetre;
    state_.move({left_m, right_m, kVariance_m * std::abs(left_m), kVariance_m * std::abs(right_m)},
                track_m_);
  }

  const DeadReckoning& state() const { return state_; }

  /// The twist that it takes wheels with these real rim speeds to make.
  Twist twist(const WheelSpeeds& rim) const {
    return to_twist({rim.left_mps / radius_ratio_, rim.right_mps / radius_ratio_}, track_m_);
  }

 private:
  double radius_m_;
  double track_m_;
  double radius_ratio_;
  double left_angle_rad_ = 0.0;
  double right_angle_rad_ = 0.0;
  DeadReckoning state_;
};

}  // namespace tether
