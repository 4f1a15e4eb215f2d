#pragma once

#include "common/vehicle/pose.hpp"

namespace tether {

/// Upper triangle of a pose's covariance matrix: x and y in the world's frame, in metres, yaw in
/// radians, counter-clockwise positive (REP-103).
struct PoseCovariance {
  double x_x = 0.0;
  double x_y = 0.0;
  double x_yaw = 0.0;
  double y_y = 0.0;
  double y_yaw = 0.0;
  double yaw_yaw = 0.0;

  /// Adds an error along (x, y, yaw) with this variance.
  void add(double x, double y, double yaw, double variance);
};

/// Travel of both rims between two readings of their encoders, with its uncertainty.
struct RolledWays {
  double left_m = 0.0;
  double right_m = 0.0;
  double left_variance_m2 = 0.0;
  double right_variance_m2 = 0.0;
};

/// Where a vehicle says it is by its wheels alone.
struct DeadReckoning {
  /// Variance of a wheel's way per metre of it, for calibrated wheels on smooth floor; whence:
  /// can_bridge/safety/odometry.hpp.
  static constexpr double kVariancePerMetre = 1e-5;

  Pose2 pose;  ///< pose of the axle's midpoint
  PoseCovariance covariance;
  double distance_m = 0.0;  ///< path length, never falling

  struct Step {
    double arc_m = 0.0;
    double turn_rad = 0.0;
    double direction_rad = 0.0;  ///< direction of the chord, in the world
  };
  /// Both wheels turned at a constant ratio, so that the axle's midpoint ran along an arc: of
  /// length d = (d_l + d_r)/2 and angle a = (d_r − d_l)/track, with the chord d·sin(a/2)/(a/2) in
  /// direction yaw + a/2. The covariance follows to first order: F P Fᵀ of the pose before, and
  /// that of each wheel's way, errors of their own.
  Step move(const RolledWays& ways, double track_m);
};

}  // namespace tether
