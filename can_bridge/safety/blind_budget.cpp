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

double BlindBudget::left_m() const { return std::max(0.0, config_.max_distance_m - blind_m_); }

double BlindBudget::stopping_from(double deceleration_mps2, double distance_m) const {
  const double r = to_seconds(config_.reaction);
  const double a = deceleration_mps2;
  return a * (std::sqrt(r * r + 2.0 * distance_m / a) - r);
}

double BlindBudget::share(const Twist& twist) const {
  const double a = config_.deceleration_mps2;
  const double wheel_a = config_.wheel_deceleration_mps2;
  const double t =
      blind_ < config_.max_time ? to_seconds(config_.max_time - blind_ - config_.reaction) : 0.0;
  const double by_time = std::max(0.0, t);
  const double v = std::abs(twist.v_mps);
  const double h = std::abs(twist.omega_radps) * config_.half_track_m;
  const auto part = [](double limit, double value) {
    return std::abs(value) > limit ? limit / std::abs(value) : 1.0;
  };
  double share = std::min({part(a * by_time, v), part(wheel_a * by_time, v + h),
                           part(config_.yaw_deceleration_radps2 * by_time, twist.omega_radps)});
  if (v > 0.0) {
    // On this curve a stop by the drives takes as far as a deceleration of the vehicle by this.
    const double by_wheels = wheel_a * (h > v ? v / (2.0 * h) : v * v / (v * v + h * h));
    share = std::min(share, part(stopping_from(std::min(a, by_wheels), left_m()), v));
  }
  return share;
}

double BlindBudget::speed_beside(double omega_radps) const {
  const double a = config_.wheel_deceleration_mps2;
  const double h = std::abs(omega_radps) * config_.half_track_m;
  double by_wheels = left_m() / (to_seconds(config_.reaction) + h / a);
  if (by_wheels > h) by_wheels = stopping_from(a, left_m() - h * h / (2.0 * a));
  return std::min(by_wheels, stopping_from(config_.deceleration_mps2, left_m()));
}

}  // namespace tether
