#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "common/vehicle/dead_reckoning.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// Where the vehicle takes itself to be by its wheels' encoders alone: dead reckoning from its
/// nominal start, with the radius and the track that it believes in. So vehicle.radius_error,
/// vehicle.track_error, slip and an uncertain start show as errors that it knows nothing of; its
/// covariance grows as that of the CAN bridge (can_bridge/safety/odometry.hpp), which takes radius
/// and track to be calibrated.
///
/// With sensor.encoder_ticks an angle is read to the nearest of so many a turn, and a rim's way is
/// off by up to half of q, the way of a tick: with a variance of q²/12 that does not add up, since
/// the next tick makes good for it. So the pose is, beside the above, uncertain
/// - along its heading by q²/24, the mean of both wheels', and in yaw by q²/(6 track²);
/// - sideways by the yaw's error times each way between two readings, or a tick if that is longer,
///   each independent of the others: a random walk.
class WheelOdometry {
 public:
  /// `ticks`: sensor.encoder_ticks.
  explicit WheelOdometry(const VehicleSettings& vehicle, std::int64_t ticks = 0)
      : radius_m_(vehicle.wheel_radius_m / (1.0 + vehicle.radius_error)),
        track_m_(vehicle.track_m * (1.0 + vehicle.track_error)),
        radius_ratio_(1.0 + vehicle.radius_error),
        tick_rad_(ticks > 0 ? 2.0 * std::numbers::pi / static_cast<double>(ticks) : 0.0) {
    state_.pose = vehicle.start_pose();
  }

  /// The encoders' angles since the start.
  void update(double left_turned_rad, double right_turned_rad) {
    const double left_angle_rad = read(left_turned_rad), right_angle_rad = read(right_turned_rad);
    const double left_m = (left_angle_rad - left_angle_rad_) * radius_m_;
    const double right_m = (right_angle_rad - right_angle_rad_) * radius_m_;
    left_angle_rad_ = left_angle_rad;
    right_angle_rad_ = right_angle_rad;
    constexpr double kVariance_m = DeadReckoning::kVariancePerMetre;
    const auto step = state_.move(
        {left_m, right_m, kVariance_m * std::abs(left_m), kVariance_m * std::abs(right_m)},
        track_m_);
    if (tick_rad_ == 0.0) return;
    const double way_m = std::abs(step.arc_m);
    state_.covariance.add(-std::sin(step.direction_rad), std::cos(step.direction_rad), 0.0,
                          way_m * std::max(way_m, tick_rad_ * radius_m_) * tick_yaw_variance());
  }

  /// State as of the last update.
  DeadReckoning state() const {
    DeadReckoning state = state_;
    if (tick_rad_ == 0.0) return state;
    const double yaw = state.pose.yaw_rad, tick_m = tick_rad_ * radius_m_;
    state.covariance.add(std::cos(yaw), std::sin(yaw), 0.0, tick_m * tick_m / 24.0);
    state.covariance.add(0.0, 0.0, 1.0, tick_yaw_variance());
    return state;
  }

  /// The twist that it takes wheels with these real rim speeds to make.
  Twist twist(const WheelSpeeds& rim) const {
    return to_twist({rim.left_mps / radius_ratio_, rim.right_mps / radius_ratio_}, track_m_);
  }

 private:
  double read(double angle_rad) const {
    return tick_rad_ == 0.0 ? angle_rad : tick_rad_ * std::nearbyint(angle_rad / tick_rad_);
  }
  double tick_yaw_variance() const {
    const double tick_m = tick_rad_ * radius_m_;
    return tick_m * tick_m / (6.0 * track_m_ * track_m_);
  }

  double radius_m_;
  double track_m_;
  double radius_ratio_;
  double tick_rad_;  ///< 0: angles are exact
  double left_angle_rad_ = 0.0;
  double right_angle_rad_ = 0.0;
  DeadReckoning state_;
};

}  // namespace tether
