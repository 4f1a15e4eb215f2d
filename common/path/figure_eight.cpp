#include "common/path/figure_eight.hpp"

#include <cmath>
#include <numbers>

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

}  // namespace tether
