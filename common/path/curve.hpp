#pragma once

#include <limits>
#include <string>

namespace tether {

struct CurvePoint {
  double x_m = 0.0;
  double y_m = 0.0;
  double yaw_rad = 0.0;        ///< direction of the tangent, (−π, π]
  double curvature_1pm = 0.0;  ///< d yaw/ds, positive to the left
};

/// Where a path goes, without its timing: a curve with a continuous tangent, by arc length.
/// Immutable.
class PathCurve {
 public:
  virtual ~PathCurve() = default;

  virtual double length_m() const = 0;  ///< length of one lap if closed; positive; positive
  virtual bool is_closed() const = 0;
  /// `s_m` in [0, length_m()]; beyond, the nearer end.
  virtual CurvePoint at(double s_m) const = 0;

  /// The speed that is wanted there; the cruise speed where none is.
  virtual double wanted_speed_mps(double /*s_m*/) const {
    return std::numeric_limits<double>::infinity();
  }
  /// "file:line" of what put the curve there; empty if there is no file.
  virtual std::string source(double /*s_m*/) const { return {}; }
};

}  // namespace tether
