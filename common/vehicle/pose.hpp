#pragma once

#include <cmath>
#include <numbers>

namespace tether {

/// Planar pose in the world frame (REP-103: x forward, y left, yaw counter-clockwise).
struct Pose2 {
  double x_m = 0.0;
  double y_m = 0.0;
  double yaw_rad = 0.0;  ///< in (−π, π] wherever it crosses an interface

  bool operator==(const Pose2&) const = default;
};

/// Returns the distance of their positions.
inline double distance_m(const Pose2& a, const Pose2& b) {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m);
}

/// Body velocity of a vehicle that cannot move sideways.
struct Twist {
  double v_mps = 0.0;        ///< forward speed of the axle's midpoint
  double omega_radps = 0.0;  ///< yaw rate, counter-clockwise positive
};

inline bool stands_still(const Twist& u) { return u.v_mps == 0.0 && u.omega_radps == 0.0; }

/// Numbers from the network beyond this are as useless as NaN: arithmetic on them would overflow.
inline constexpr double kLargestUsable = 1e9;

/// False for NaN, infinities and magnitudes from kLargestUsable on.
inline bool is_usable(double x) { return std::abs(x) < kLargestUsable; }
inline bool is_usable(const Pose2& p) {
  return is_usable(p.x_m) && is_usable(p.y_m) && is_usable(p.yaw_rad);
}
inline bool is_usable(const Twist& u) { return is_usable(u.v_mps) && is_usable(u.omega_radps); }

/// The same angle in (−π, π]. Finite input only.
inline double wrap_angle(double angle_rad) {
  if (std::abs(angle_rad) < std::numbers::pi) return angle_rad;
  const double wrapped = std::remainder(angle_rad, 2.0 * std::numbers::pi);
  return wrapped <= -std::numbers::pi ? std::numbers::pi : wrapped;
}

}  // namespace tether
