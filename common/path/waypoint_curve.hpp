#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/path/curve.hpp"
#include "common/path/waypoints.hpp"

namespace tether {

/// The interpolating cubic spline with a continuous second derivative (de Boor, A Practical Guide
/// to Splines, chapter IV). It is ours because Boost's interpolators want even knots for that, or
/// given slopes, and Eigen's splines know neither natural nor periodic ends.
class CubicSpline {
 public:
  enum class Ends {
    natural,  ///< no second derivative at the ends
    periodic  ///< both ends are one point, which the spline passes as smoothly as the others
  };
  struct Value {
    double y = 0.0, first = 0.0, second = 0.0;  ///< with its derivatives
  };

  /// Through (u_k, y_k): u strictly ascending, two points or more; periodic: y begins and ends with
  /// the same value, four points or more.
  CubicSpline(std::vector<double> u, std::vector<double> y, Ends ends);

  /// `segment` is k of u_k <= u <= u_{k+1}.
  Value at(std::size_t segment, double u) const;

 private:
  std::vector<double> u_, y_;
  std::vector<double> second_;  // second derivatives at u_k
};

/// A cubic spline in x and y through waypoints, with the length of the chords as its parameter:
/// continuous curvature, also where a closed one begins; open ones end without curvature. Arc
/// lengths are integrals by Gauss' rule, their inverse is found by Newton's iteration, to 1e-9 m.
class WaypointCurve final : public PathCurve {
 public:
  /// `waypoints` as read_waypoints() gives them.
  explicit WaypointCurve(const Waypoints& waypoints);

  double length_m() const override { return knots_.back().s_m; }
  bool is_closed() const override { return closed_; }
  CurvePoint at(double s_m) const override;
  /// Between waypoints the square is linear in the arc length: an even acceleration.
  double wanted_speed_mps(double s_m) const override;
  /// Source of the last waypoint up to `s_m`.
  std::string source(double s_m) const override;

  /// Where each waypoint is.
  const std::vector<double>& waypoints_s_m() const { return waypoint_s_m_; }

 private:
  struct Knot {
    double s_m = 0.0, u = 0.0;
    std::size_t segment = 0;  ///< segment of the spline, from here on
  };
  double speed(std::size_t segment, double u) const;
  double arc_m(std::size_t segment, double from_u, double to_u) const;
  double parameter(const Knot& from, const Knot& to, double s_m) const;
  std::size_t waypoint_before(double s_m) const;

  std::string file_;
  std::vector<Waypoint> points_;
  bool closed_;
  CubicSpline x_, y_;
  std::vector<Knot> knots_;  ///< several in each segment, and the end
  std::vector<double> waypoint_s_m_;
};

}  // namespace tether
