#pragma once

#include "common/vehicle/dead_reckoning.hpp"

namespace tether {

/// Information of a measurement on a pose: the inverse of a covariance, in 1/m², 1/(m rad) and
/// 1/rad². It may be singular: then the measurement says nothing of some direction.
using PoseInformation = PoseCovariance;

/// The direction in which information says least of the position, whatever the yaw is, and what it
/// says of the yaw, wherever the vehicle is. Standard deviations, at most kNothing.
struct Weakness {
  static constexpr double kNothing = 1e3;
  double direction_rad = 0.0;  ///< world frame, in (−π/2, π/2]
  double sigma_m = kNothing;   ///< standard deviation of the position along it
  double yaw_sigma_rad = kNothing;
};
Weakness weakness(const PoseInformation& information);

/// The inverse of information that is not singular.
PoseCovariance covariance_of(const PoseInformation& information);

}  // namespace tether
