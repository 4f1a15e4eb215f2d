#include "sim/node/metrics.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

void Metrics::start(double error_m, double at_s) {
  last_error_m_ = max_error_m_ = error_m;
  now_s_ = at_s;
  if (error_m > settings_.lost_beyond_m) away_from_s_ = at_s;
}

void Metrics::add(double dt_s, double error_m, double wall_contact_s) {
  now_s_ += dt_s;
  elapsed_s_ += dt_s;
  error_integral_ += 0.5 * (last_error_m_ + error_m) * dt_s;
  square_integral_ += 0.5 * (last_error_m_ * last_error_m_ + error_m * error_m) * dt_s;
  wall_contact_s_ += wall_contact_s;
  max_error_m_ = std::max(max_error_m_, error_m);
  add_settled(dt_s, error_m);
  follow_excursion(dt_s, error_m);
  last_error_m_ = error_m;
}

double Metrics::epsilon_m() const {
  return elapsed_s_ > 0.0 ? error_integral_ / elapsed_s_ : last_error_m_;
}

double Metrics::rmse_m() const {
  return elapsed_s_ > 0.0 ? std::sqrt(square_integral_ / elapsed_s_) : last_error_m_;
}

double Metrics::settled_epsilon_m() const {
  return settled_s_ > 0.0 ? settled_integral_ / settled_s_ : last_error_m_;
}

double Metrics::settled_max_error_m() const {
  return settled_s_ > 0.0 ? settled_max_error_m_ : last_error_m_;
}

void Metrics::add_settled(double dt_s, double error_m) {
  const double counted_s = std::min(dt_s, now_s_ - settings_.settled_from_s);
  if (counted_s <= 0.0) return;
  const double from_m = error_m + (last_error_m_ - error_m) * (counted_s / dt_s);
  settled_s_ += counted_s;
  settled_integral_ += 0.5 * (from_m + error_m) * counted_s;
  settled_max_error_m_ = std::max({settled_max_error_m_, from_m, error_m});
}

void Metrics::follow_excursion(double dt_s, double error_m) {
  const double limit_m = settings_.lost_beyond_m;
  const bool is_beyond = error_m > limit_m;
  if (is_beyond || away_from_s_) {
    const double left_share =  // share of this step after the error passed the limit
        error_m != last_error_m_ ? (error_m - limit_m) / (error_m - last_error_m_) : 0.0;
    const double passed_s = now_s_ - dt_s * std::clamp(left_share, 0.0, 1.0);
    if (is_beyond && !away_from_s_) away_from_s_ = passed_s;
    const double until_s = is_beyond ? now_s_ : passed_s;
    if (!lost_from_s_ && until_s - *away_from_s_ >= settings_.lost_for_s) {
      lost_from_s_ = away_from_s_;
    }
    if (!is_beyond) {
      return_s_ = std::max(return_s_, until_s - *away_from_s_);
      away_from_s_.reset();
    }
  }
}

}  // namespace tether
