#pragma once

#include <cmath>

#include "common/vehicle/pose.hpp"

namespace tether {

/// Converts `there` from the frame `frame` to the parent frame of `frame`.
inline Pose2 compose(const Pose2& frame, const Pose2& there) {
  const double c = std::cos(frame.yaw_rad), s = std::sin(frame.yaw_rad);
  return {frame.x_m + c * there.x_m - s * there.y_m, frame.y_m + s * there.x_m + c * there.y_m,
          wrap_angle(frame.yaw_rad + there.yaw_rad)};
}

/// Where `to` is, in the frame of `from`: compose(from, relative_to(from, to)) is `to`.
inline Pose2 relative_to(const Pose2& from, const Pose2& to) {
  const double c = std::cos(from.yaw_rad), s = std::sin(from.yaw_rad);
  const double x_m = to.x_m - from.x_m, y_m = to.y_m - from.y_m;
  return {c * x_m + s * y_m, c * y_m - s * x_m, wrap_angle(to.yaw_rad - from.yaw_rad)};
}

/// The pose behind an arc of this length, on which the vehicle turns by `turn_rad`.
inline Pose2 along_arc(const Pose2& from, double length_m, double turn_rad) {
  const double half_rad = 0.5 * turn_rad, direction_rad = from.yaw_rad + half_rad;
  const double chord_m = length_m * (half_rad == 0.0 ? 1.0 : std::sin(half_rad) / half_rad);
  return {from.x_m + chord_m * std::cos(direction_rad),
          from.y_m + chord_m * std::sin(direction_rad), wrap_angle(from.yaw_rad + turn_rad)};
}

}  // namespace tether
