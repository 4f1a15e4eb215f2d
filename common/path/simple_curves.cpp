#include "common/path/simple_curves.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/quadrature/gauss.hpp>
#include <cmath>
#include <numbers>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"

namespace tether {

FigureEight::FigureEight(const Config& config)
    : amplitude_m_(config.amplitude_m),
      rate_radps_(config.rate_radps),
      theta_rad_(2.0 * std::numbers::pi * config.phase),
      x_m_(config.x_m),
      y_m_(config.y_m),
      cos_(std::cos(config.rotation_rad)),
      sin_(std::sin(config.rotation_rad)) {}

Position FigureEight::position_at(double t_s) const {
  const double theta = theta_rad_ + rate_radps_ * t_s;
  const double u = amplitude_m_ * std::sin(theta);
  const double w = u * std::cos(theta);
  return {x_m_ + cos_ * u - sin_ * w, y_m_ + sin_ * u + cos_ * w};
}

PathPoint FigureEight::at(double t_s) const {
  const double theta = theta_rad_ + rate_radps_ * t_s;
  const double sine = std::sin(theta);
  const double cosine = std::cos(theta);
  const double u = amplitude_m_ * sine;
  const double w = u * cosine;
  // Derivatives by theta: u = A sin, w = A/2 sin 2θ. The speed is never zero.
  const double du = amplitude_m_ * cosine;
  const double dw = amplitude_m_ * (cosine * cosine - sine * sine);
  const double ddu = -u;
  const double ddw = -4.0 * w;
  const double dx = cos_ * du - sin_ * dw;
  const double dy = sin_ * du + cos_ * dw;
  const double speed_squared = du * du + dw * dw;
  PathPoint p;
  p.x_m = x_m_ + cos_ * u - sin_ * w;
  p.y_m = y_m_ + sin_ * u + cos_ * w;
  p.yaw_rad = std::atan2(dy, dx);
  p.v_mps = rate_radps_ * std::sqrt(speed_squared);
  p.omega_radps = rate_radps_ * (du * ddw - dw * ddu) / speed_squared;
  return p;
}

PathKind figure_eight_path() {
  return {.name = "figure_eight",
          .keys = {"amplitude_m", "rate_radps", "rotation_rad"},
          .timed = [](const PathSettings& s) -> std::shared_ptr<const ReferencePath> {
            FigureEight::Config config = s.figure_eight;
            config.phase = s.phase;
            config.x_m = s.offset_x_m;
            config.y_m = s.offset_y_m;
            return std::make_shared<FigureEight>(config);
          }};
}

namespace {

constexpr double kPi = std::numbers::pi;

/// `p`, given in the frame of `start`, in the world's.
CurvePoint from_frame(const Pose2& start, const CurvePoint& p) {
  const double cosine = std::cos(start.yaw_rad), sine = std::sin(start.yaw_rad);
  return {start.x_m + cosine * p.x_m - sine * p.y_m, start.y_m + sine * p.x_m + cosine * p.y_m,
          wrap_angle(start.yaw_rad + p.yaw_rad), p.curvature_1pm};
}

CurvePoint mirrored(const CurvePoint& p) { return {p.x_m, -p.y_m, -p.yaw_rad, -p.curvature_1pm}; }

}  // namespace

CurvePoint StraightCurve::at(double s_m) const {
  return from_frame(start_, {std::clamp(s_m, 0.0, length_m_), 0.0, 0.0, 0.0});
}

CircleCurve::CircleCurve(const Pose2& start, double radius_m, bool clockwise)
    : start_(start), curvature_1pm_((clockwise ? -1.0 : 1.0) / radius_m) {}

double CircleCurve::length_m() const { return 2.0 * kPi / std::abs(curvature_1pm_); }

CurvePoint CircleCurve::at(double s_m) const {
  const double turned = std::clamp(s_m, 0.0, length_m()) * curvature_1pm_;
  return from_frame(start_, {std::sin(turned) / curvature_1pm_,
                             (1.0 - std::cos(turned)) / curvature_1pm_, turned, curvature_1pm_});
}

// Half of the turn, 45°, is the mean curvature 1/(2 radius) times its length.
ClothoidCorner::ClothoidCorner(double least_radius_m)
    : radius_m_(least_radius_m), half_length_m_(0.5 * kPi * least_radius_m), reach_m_(0.0) {
  const CurvePoint middle = first_half(half_length_m_);
  reach_m_ = middle.x_m + middle.y_m;
}

CurvePoint ClothoidCorner::first_half(double s_m) const {
  const double yaw_per_square = 0.5 / (radius_m_ * half_length_m_);
  using Gauss = boost::math::quadrature::gauss<double, 15>;  // to 1e-15 up to 45°
  const auto yaw = [yaw_per_square](double s) { return yaw_per_square * s * s; };
  CurvePoint p;
  p.x_m = Gauss::integrate([&](double s) { return std::cos(yaw(s)); }, 0.0, s_m);
  p.y_m = Gauss::integrate([&](double s) { return std::sin(yaw(s)); }, 0.0, s_m);
  p.yaw_rad = yaw(s_m);
  p.curvature_1pm = s_m / (radius_m_ * half_length_m_);
  return p;
}

CurvePoint ClothoidCorner::at(double s_m) const {
  if (s_m <= half_length_m_) return first_half(std::max(0.0, s_m));
  // The second half is the first one backwards, mirrored at the line x + y = reach.
  const CurvePoint p = first_half(std::max(0.0, 2.0 * half_length_m_ - s_m));
  return {reach_m_ - p.y_m, reach_m_ - p.x_m, 0.5 * kPi - p.yaw_rad, p.curvature_1pm};
}

RoundedRectangleCurve::RoundedRectangleCurve(const Pose2& start, const Config& config)
    : start_(start), config_(config), corner_(config.corner_radius_m) {
  const double least_m = 2.0 * corner_.reach_m();
  if (std::min(config.length_m, config.width_m) >= least_m) return;
  throw UsageError(
      fmt::format("path.corner_radius_m = {} does not fit: path.length_m and path.width_m must "
                  "be at least {:.3f}; they are {} and {} (a corner takes 1.87 times its radius of "
                  "each side)",
                  config.corner_radius_m, least_m, config.length_m, config.width_m));
}

double RoundedRectangleCurve::length_m() const {
  const double straight_m = 2.0 * (config_.length_m + config_.width_m) - 8.0 * corner_.reach_m();
  return straight_m + 4.0 * corner_.length_m();
}

/// A quarter of the way round, from the middle of a side of length `first_m`: straight on, a
/// corner, and straight on to the middle of the next side, of length `second_m`.
CurvePoint RoundedRectangleCurve::quarter(double s_m, double first_m, double second_m) const {
  const double before_m = 0.5 * first_m - corner_.reach_m();
  if (s_m <= before_m) return {s_m, 0.0, 0.0, 0.0};
  const double beyond_m = s_m - before_m - corner_.length_m();
  if (beyond_m > 0.0) {
    return {0.5 * first_m, std::min(0.5 * second_m, corner_.reach_m() + beyond_m), 0.5 * kPi, 0.0};
  }
  CurvePoint p = corner_.at(s_m - before_m);
  p.x_m += before_m;
  return p;
}

CurvePoint RoundedRectangleCurve::at(double s_m) const {
  const double quarter_m = 0.25 * length_m();
  const double along_m = std::clamp(s_m, 0.0, length_m());
  const int number = std::min(3, static_cast<int>(along_m / quarter_m));
  const double length = config_.length_m, width = config_.width_m;
  const double rest_m = along_m - number * quarter_m;
  const CurvePoint p =
      number % 2 == 0 ? quarter(rest_m, length, width) : quarter(rest_m, width, length);
  // The middles of the sides.
  const Pose2 middle[] = {{0.0, 0.0, 0.0},
                          {0.5 * length, 0.5 * width, 0.5 * kPi},
                          {0.0, width, kPi},
                          {-0.5 * length, 0.5 * width, -0.5 * kPi}};
  const CurvePoint left = from_frame(middle[number], p);
  return from_frame(start_, config_.clockwise ? mirrored(left) : left);
}

PathKind circle_path() {
  return {.name = "circle",
          .keys = {"radius_m", "clockwise", "start_x_m", "start_y_m", "start_yaw_rad", "speed_mps",
                   "max_acceleration_mps2", "max_lateral_acceleration_mps2", "max_yaw_rate_radps",
                   "max_yaw_acceleration_radps2"},
          .curve = [](const PathSettings& s) -> std::unique_ptr<const PathCurve> {
            return std::make_unique<CircleCurve>(s.start, s.radius_m, s.clockwise);
          }};
}

PathKind line_path() {
  return {.name = "line",
          .keys = {"length_m", "start_x_m", "start_y_m", "start_yaw_rad", "speed_mps",
                   "max_acceleration_mps2", "max_deceleration_mps2"},
          .curve = [](const PathSettings& s) -> std::unique_ptr<const PathCurve> {
            return std::make_unique<StraightCurve>(s.start, s.length_m);
          }};
}

PathKind rounded_rectangle_path() {
  return {.name = "rounded_rectangle",
          .keys = {"length_m", "width_m", "corner_radius_m", "clockwise", "start_x_m", "start_y_m",
                   "start_yaw_rad", "speed_mps", "max_acceleration_mps2", "max_deceleration_mps2",
                   "max_lateral_acceleration_mps2", "max_yaw_rate_radps",
                   "max_yaw_acceleration_radps2"},
          .curve = [](const PathSettings& s) -> std::unique_ptr<const PathCurve> {
            return std::make_unique<RoundedRectangleCurve>(
                s.start, RoundedRectangleCurve::Config{s.length_m, s.width_m, s.corner_radius_m,
                                                       s.clockwise});
          }};
}

}  // namespace tether
