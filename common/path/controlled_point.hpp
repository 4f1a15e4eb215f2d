#pragma once

#include <cmath>

#include "common/path/path_settings.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// How far ahead of the axle's midpoint the point is that follows the path (path.point).
inline double controlled_point_ahead_m(const PathSettings& path, const VehicleConfig& vehicle) {
  return path.point == PathSettings::Point::chassis ? -vehicle.axle_x_m : 0.0;
}

/// The point that is `ahead_m` ahead of the axle's midpoint.
inline Position point_ahead(const Pose2& axle, double ahead_m) {
  return {axle.x_m + ahead_m * std::cos(axle.yaw_rad), axle.y_m + ahead_m * std::sin(axle.yaw_rad)};
}

}  // namespace tether
