#pragma once

// For .cpp files that compute with Eigen.

#include <Eigen/Core>

#include "common/vehicle/dead_reckoning.hpp"

namespace tether {

inline Eigen::Matrix3d matrix_of(const PoseCovariance& p) {
  Eigen::Matrix3d m;
  m << p.x_x, p.x_y, p.x_yaw, p.x_y, p.y_y, p.y_yaw, p.x_yaw, p.y_yaw, p.yaw_yaw;
  return m;
}

/// Covariance from the upper triangle.
inline PoseCovariance covariance_from(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)};
}

}  // namespace tether
