#pragma once

#include <cstddef>

#include "common/vehicle/pose.hpp"
#include "controller/laws/pose_filter.hpp"

namespace tether {

/// The normalised squared error of the estimated pose: χ² of 3 degrees of freedom. By Cramer's
/// rule, so that a test does not share the filter's algebra.
inline double pose_nees(const PoseFilter& filter, const Pose2& truth) {
  const auto& p = filter.covariance();
  const auto at = [&](std::size_t i, std::size_t j) { return p[i * PoseFilter::kStates + j]; };
  const Pose2& pose = filter.state().pose;
  const double e[3] = {truth.x_m - pose.x_m, truth.y_m - pose.y_m,
                       wrap_angle(truth.yaw_rad - pose.yaw_rad)};
  double adjugate[3][3], det = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      const std::size_t a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
      adjugate[i][j] = at(a, c) * at(b, d) - at(a, d) * at(b, c);
      sum += e[i] * adjugate[i][j] * e[j];
    }
  }
  for (std::size_t j = 0; j < 3; ++j) det += at(0, j) * adjugate[j][0];
  return sum / det;
}

}  // namespace tether
