#pragma once

#include <algorithm>
#include <cmath>

#include "common/vehicle/pose.hpp"

namespace tether {

/// Rim speeds of the two drive wheels, metres per second, forward positive.
struct WheelSpeeds {
  double left_mps = 0.0;
  double right_mps = 0.0;

  bool operator==(const WheelSpeeds&) const = default;
};

/// Differential-drive kinematics without slip, REP-103 axes, `track_m` between wheel centres:
/// v = (v_l + v_r)/2, ω = (v_r − v_l)/track. (The paper prints ω with the opposite sign, which
/// contradicts its own wheel positions; see docs/explanation/physics.md.)
inline Twist to_twist(const WheelSpeeds& w, double track_m) {
  return {(w.left_mps + w.right_mps) / 2.0, (w.right_mps - w.left_mps) / track_m};
}

/// Inverse of to_twist.
inline WheelSpeeds to_wheel_speeds(const Twist& u, double track_m) {
  const double half_difference = u.omega_radps * track_m / 2.0;
  return {u.v_mps - half_difference, u.v_mps + half_difference};
}

/// Scales both wheels by one factor so that neither exceeds `max_mps`: keeps the curvature.
inline WheelSpeeds saturate(const WheelSpeeds& w, double max_mps) {
  const double fastest = std::max(std::abs(w.left_mps), std::abs(w.right_mps));
  if (fastest <= max_mps) return w;
  const double scale = max_mps / fastest;
  return {w.left_mps * scale, w.right_mps * scale};
}

/// Moves each wheel towards its target, by at most `max_change_mps`.
inline WheelSpeeds approach(const WheelSpeeds& from, const WheelSpeeds& to, double max_change_mps) {
  const auto nearer = [max_change_mps](double a, double b) {
    return a + std::clamp(b - a, -max_change_mps, max_change_mps);
  };
  return {nearer(from.left_mps, to.left_mps), nearer(from.right_mps, to.right_mps)};
}

}  // namespace tether
