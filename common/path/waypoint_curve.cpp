#include "common/path/waypoint_curve.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/quadrature/gauss.hpp>
#include <cassert>
#include <cmath>
#include <utility>

#include "common/vehicle/pose.hpp"

namespace tether {
namespace {

using Numbers = std::vector<double>;

/// Solves a tridiagonal system with a dominant diagonal (Thomas). Row i is below[i] x[i-1] +
/// diagonal[i] x[i] + above[i] x[i+1] = right[i]; below[0] and above[n-1] are ignored.
Numbers solve(const Numbers& below, Numbers diagonal, const Numbers& above, Numbers right) {
  const std::size_t n = diagonal.size();
  for (std::size_t i = 1; i < n; ++i) {
    const double factor = below[i] / diagonal[i - 1];
    diagonal[i] -= factor * above[i - 1];
    right[i] -= factor * right[i - 1];
  }
  for (std::size_t i = n; i-- > 0;) {
    if (i + 1 < n) right[i] -= above[i] * right[i + 1];
    right[i] /= diagonal[i];
  }
  return right;
}

/// The same for a ring: below[0] is x[n-1]'s factor, above[n-1] is x[0]'s (Sherman-Morrison).
Numbers solve_ring(const Numbers& below, Numbers diagonal, const Numbers& above,
                   const Numbers& right) {
  const std::size_t last = diagonal.size() - 1;
  const double gamma = -diagonal[0];
  Numbers edge(diagonal.size(), 0.0);
  edge[0] = gamma;
  edge[last] = above[last];
  diagonal[last] -= above[last] * below[0] / gamma;
  diagonal[0] -= gamma;
  Numbers x = solve(below, diagonal, above, right);
  const Numbers z = solve(below, diagonal, above, edge);
  const double share = below[0] / gamma;
  const double factor = (x[0] + share * x[last]) / (1.0 + z[0] + share * z[last]);
  for (std::size_t i = 0; i <= last; ++i) x[i] -= factor * z[i];
  return x;
}

}  // namespace

CubicSpline::CubicSpline(Numbers u, Numbers y, Ends ends) : u_(std::move(u)), y_(std::move(y)) {
  const bool is_ring = ends == Ends::periodic;
  const std::size_t segments = u_.size() - 1;
  assert(y_.size() == u_.size() && segments >= (is_ring ? 3U : 1U));
  second_.assign(u_.size(), 0.0);
  // One row for each point with a segment on both sides: of a ring, each but the last.
  Numbers below, diagonal, above, right;
  for (std::size_t k = is_ring ? 0 : 1; k < segments; ++k) {
    const std::size_t before = k == 0 ? segments - 1 : k - 1;
    const double h = u_[before + 1] - u_[before], next = u_[k + 1] - u_[k];
    below.push_back(h / 6.0);
    diagonal.push_back((h + next) / 3.0);
    above.push_back(next / 6.0);
    right.push_back((y_[k + 1] - y_[k]) / next - (y_[before + 1] - y_[before]) / h);
  }
  if (diagonal.empty()) return;
  const Numbers x =
      is_ring ? solve_ring(below, diagonal, above, right) : solve(below, diagonal, above, right);
  for (std::size_t i = 0; i < x.size(); ++i) second_[i + (is_ring ? 0 : 1)] = x[i];
  if (is_ring) second_.back() = second_.front();
}

CubicSpline::Value CubicSpline::at(std::size_t segment, double u) const {
  const std::size_t k = segment;
  const double h = u_[k + 1] - u_[k];
  const double b = (u - u_[k]) / h, a = 1.0 - b;
  const double slope = (y_[k + 1] - y_[k]) / h;
  return {
      a * y_[k] + b * y_[k + 1] +
          ((a * a * a - a) * second_[k] + (b * b * b - b) * second_[k + 1]) * h * h / 6.0,
      slope + ((1.0 - 3.0 * a * a) * second_[k] + (3.0 * b * b - 1.0) * second_[k + 1]) * h / 6.0,
      a * second_[k] + b * second_[k + 1]};
}

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
