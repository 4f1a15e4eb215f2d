#pragma once

#include <cmath>

namespace tether {

/// Where the vehicle's controlled point (path.point), usually its axle's midpoint, should be and
/// how it should move there (world frame, REP-103).
struct PathPoint {
  double x_m = 0.0;
  double y_m = 0.0;
  double yaw_rad = 0.0;  ///< direction of travel, (−π, π]; where the path rests: the last one
  double v_mps = 0.0;    ///< ≥ 0, along yaw_rad
  double omega_radps = 0.0;  ///< yaw rate
};

struct Position {
  double x_m = 0.0;
  double y_m = 0.0;

  bool operator==(const Position&) const = default;
};

inline double distance_m(const Position& a, const Position& b) {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m);
}

/// A path with its timing: one point for each instant. A path with an end rests there from then on.
/// A path that begins at rest also rests at its start before t = 0. Immutable; safe to share.
class ReferencePath {
 public:
  virtual ~ReferencePath() = default;

  /// `t_s` seconds after the run's start; any finite time.
  virtual PathPoint at(double t_s) const = 0;
  /// The same point without heading and twist, for metrics, which ask each millisecond.
  virtual Position position_at(double t_s) const {
    const PathPoint p = at(t_s);
    return {p.x_m, p.y_m};
  }
};

}  // namespace tether
