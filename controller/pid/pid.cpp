#include "controller/pid/pid.hpp"

#include <algorithm>
#include <cmath>

#include "common/vehicle/pose.hpp"

namespace tether {

double Pid::step(double error, double dt_s) {
  if (!state_.started) {
    dt_s = 0.0;  // the time before the first step does not count
    state_ = {};
    state_.started = true;
    state_.filtered_error = error;
  } else if (dt_s > 0.0) {
    double difference = error - state_.filtered_error;
    if (config_.angular) difference = wrap_angle(difference);
    const double change = difference * dt_s / (config_.derivative_filter_s + dt_s);
    state_.filtered_error += change;
    if (config_.angular) state_.filtered_error = wrap_angle(state_.filtered_error);
    state_.derivative = change / dt_s;
  }

  const double candidate = state_.integral + config_.i * error * dt_s;
  const double output = config_.p * error + candidate + config_.d * state_.derivative;
  const bool winds_up = std::abs(output) > config_.limit && output * error > 0.0;
  if (!winds_up) state_.integral = candidate;
  return std::clamp(config_.p * error + state_.integral + config_.d * state_.derivative,
                    -config_.limit, config_.limit);
}

}  // namespace tether
