#include "common/figure_eight.hpp"

#include <cmath>

namespace tether {

FigureEight::FigureEight(const Config& config)
    : amplitude_m_(config.amplitude_m),
      rate_radps_(config.rate_radps),
      cos_(std::cos(config.rotation_rad)),
      sin_(std::sin(config.rotation_rad)) {}

FigureEight::Point FigureEight::at(double t_s) const {
  const double theta = rate_radps_ * t_s;
  const double u = amplitude_m_ * std::sin(theta);
  const double w = u * std::cos(theta);
  return {cos_ * u - sin_ * w, sin_ * u + cos_ * w};
}

}  // namespace tether
