#pragma once

#include <cmath>
#include <numbers>

namespace tether {

/// Planar pose in the world frame (REP-103: x forward, y left, yaw counter-clockwise).
struct Pose2 {
  double x_m = 0.0;
  double y_m = 0.0;
  double yaw_rad = 0.0;  ///< in (−π, π] wherever it crosses an interface
};

/// Body velocity of a vehicle that cannot move sideways.
struct Twist {
  double v_mps = 0.0;        ///< forward speed of the axle's midpoint
  double omega_radps = 0.0;  ///< yaw rate, counter-clockwise positive
};

inline bool is_finite(const Pose2& p) {
  return std::isfinite(p.x_m) && std::isfinite(p.y_m) && std::isfinite(p.yaw_rad);
}

inline bool is_finite(const Twist& u) {
  return std::isfinite(u.v_mps) && std::isfinite(u.omega_radps);
}

/// The same angle in (−π, π]. Finite input only.
inline double wrap_angle(double angle_rad) {
  const double wrapped = std::remainder(angle_rad, 2.0 * std::numbers::pi);
  return wrapped <= -std::numbers::pi ? std::numbers::pi : wrapped;
}

}  // namespace tether
