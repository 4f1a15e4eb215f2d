#include "common/path/curves/waypoint_curve.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/quadrature/gauss.hpp>
#include <cmath>

#include "common/vehicle/pose.hpp"

namespace tether {
namespace {

constexpr int kKnotsPerSegment = 8;
constexpr double kArcTolerance_m = 1e-10;
constexpr int kIterations = 50;

std::vector<double> chord_lengths(const std::vector<Waypoint>& points) {
  std::vector<double> u{0.0};
  for (std::size_t i = 1; i < points.size(); ++i) {
    u.push_back(u.back() +
                std::hypot(points[i].x_m - points[i - 1].x_m, points[i].y_m - points[i - 1].y_m));
  }
  return u;
}

CubicSpline spline(const Waypoints& path, double Waypoint::*coordinate) {
  std::vector<double> y;
  for (const Waypoint& point : path.points) y.push_back(point.*coordinate);
  if (path.is_closed()) y.back() = y.front();
  return {chord_lengths(path.points), y,
          path.is_closed() ? CubicSpline::Ends::periodic : CubicSpline::Ends::natural};
}

}  // namespace

WaypointCurve::WaypointCurve(const Waypoints& waypoints)
    : file_(waypoints.file),
      points_(waypoints.points),
      closed_(waypoints.is_closed()),
      x_(spline(waypoints, &Waypoint::x_m)),
      y_(spline(waypoints, &Waypoint::y_m)) {
  const std::vector<double> u = chord_lengths(points_);
  double s_m = 0.0;
  for (std::size_t k = 0; k + 1 < u.size(); ++k) {
    waypoint_s_m_.push_back(s_m);
    const double step = (u[k + 1] - u[k]) / kKnotsPerSegment;
    for (int i = 0; i < kKnotsPerSegment; ++i) {
      const double from = u[k] + i * step;
      knots_.push_back({s_m, from, k});
      s_m += arc_m(k, from, from + step);
    }
  }
  waypoint_s_m_.push_back(s_m);
  knots_.push_back({s_m, u.back(), u.size() - 2});
}

/// Speed of the point along the curve per unit of the parameter.
double WaypointCurve::speed(std::size_t segment, double u) const {
  return std::hypot(x_.at(segment, u).first, y_.at(segment, u).first);
}

double WaypointCurve::arc_m(std::size_t segment, double from_u, double to_u) const {
  using Gauss = boost::math::quadrature::gauss<double, 7>;
  return Gauss::integrate([&](double u) { return speed(segment, u); }, from_u, to_u);
}

/// Where the arc length is `s_m`, between two knots. Newton's iteration, which halves the bracket
/// where it would leave it.
double WaypointCurve::parameter(const Knot& from, const Knot& to, double s_m) const {
  double low = from.u, high = to.u;
  const double wanted_m = s_m - from.s_m;
  double u = low + (high - low) * std::clamp(wanted_m / (to.s_m - from.s_m), 0.0, 1.0);
  for (int i = 0; i < kIterations; ++i) {
    const double miss_m = arc_m(from.segment, from.u, u) - wanted_m;
    if (std::abs(miss_m) <= kArcTolerance_m) break;
    (miss_m > 0.0 ? high : low) = u;
    const double next = u - miss_m / speed(from.segment, u);
    u = next > low && next < high ? next : 0.5 * (low + high);
  }
  return u;
}

CurvePoint WaypointCurve::at(double s_m) const {
  const double within_m = std::clamp(s_m, 0.0, length_m());
  const auto after = std::upper_bound(knots_.begin() + 1, knots_.end() - 1, within_m,
                                      [](double s, const Knot& knot) { return s < knot.s_m; });
  const Knot& from = *(after - 1);
  const double u = parameter(from, *after, within_m);
  const auto x = x_.at(from.segment, u), y = y_.at(from.segment, u);
  const double speed = std::hypot(x.first, y.first);
  return {x.y, y.y, wrap_angle(std::atan2(y.first, x.first)),
          (x.first * y.second - y.first * x.second) / (speed * speed * speed)};
}

std::size_t WaypointCurve::waypoint_before(double s_m) const {
  const auto after = std::upper_bound(waypoint_s_m_.begin() + 1, waypoint_s_m_.end() - 1, s_m);
  return static_cast<std::size_t>(after - waypoint_s_m_.begin()) - 1;
}

double WaypointCurve::wanted_speed_mps(double s_m) const {
  const std::size_t k = waypoint_before(s_m);
  const auto from = points_[k].v_mps, to = points_[k + 1].v_mps;
  if (!from || !to) return PathCurve::wanted_speed_mps(s_m);
  const double share = (s_m - waypoint_s_m_[k]) / (waypoint_s_m_[k + 1] - waypoint_s_m_[k]);
  return std::sqrt(std::lerp(*from * *from, *to * *to, std::clamp(share, 0.0, 1.0)));
}

std::string WaypointCurve::source(double s_m) const {
  const std::size_t k = waypoint_before(s_m);
  return fmt::format("{}:{}", file_, points_[s_m >= length_m() ? points_.size() - 1 : k].line);
}

}  // namespace tether
