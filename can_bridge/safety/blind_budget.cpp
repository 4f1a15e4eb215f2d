#include "can_bridge/safety/blind_budget.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

void BlindBudget::update(Instant now, double driven_m, std::optional<Instant> seen) {
  while (driven_.size() > 1 && driven_[1].when + config_.max_time <= now) driven_.pop_front();
  driven_.push_back({now, driven_m});
  if (!seen) {
    blind_ = Duration::max();
    return;
  }
  blind_ = now - *seen;
  // The last sample at or before `seen`: rather too far than too near.
  const auto after =
      std::upper_bound(driven_.begin() + 1, driven_.end(), *seen,
                       [](Instant t, const Sample& sample) { return t < sample.when; });
  blind_m_ = driven_m - (after - 1)->driven_m;
}

double BlindBudget::share(const Twist& twist) const {
  const double r = to_seconds(config_.reaction);
  const double a = config_.deceleration_mps2;
  const double t =
      blind_ < config_.max_time ? to_seconds(config_.max_time - blind_ - config_.reaction) : 0.0;
  const double d = std::max(0.0, config_.max_distance_m - blind_m_);
  const double by_time = std::max(0.0, t);
  const double v = std::min(a * by_time, a * (std::sqrt(r * r + 2.0 * d / a) - r));
  const double omega = config_.yaw_deceleration_radps2 * by_time;
  const auto part = [](double limit, double value) {
    return std::abs(value) > limit ? limit / std::abs(value) : 1.0;
  };
  return std::min(part(v, twist.v_mps), part(omega, twist.omega_radps));
}

}  // namespace tether
