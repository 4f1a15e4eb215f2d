#pragma once

#include <algorithm>
#include <cmath>

namespace tether {

/// The truth's summary. ε is the paper's metric: the time-mean of the distance to the reference,
/// ε = 1/(t1 − t0) ∫ ‖p*(t) − p(t)‖ dt, by the trapezoidal rule over the times at
/// which it is told the error.
class Metrics {
 public:
  /// The error at the start, before any time has passed.
  void start(double error_m) { last_error_m_ = max_error_m_ = error_m; }

  /// `dt_s` later the error is `error_m`; for `wall_contact_s` of it the vehicle touched a wall.
  void add(double dt_s, double error_m, double wall_contact_s) {
    elapsed_s_ += dt_s;
    error_integral_ += 0.5 * (last_error_m_ + error_m) * dt_s;
    square_integral_ += 0.5 * (last_error_m_ * last_error_m_ + error_m * error_m) * dt_s;
    wall_contact_s_ += wall_contact_s;
    max_error_m_ = std::max(max_error_m_, error_m);
    last_error_m_ = error_m;
  }

  double error_m() const { return last_error_m_; }
  double max_error_m() const { return max_error_m_; }
  double wall_contact_s() const { return wall_contact_s_; }
  /// ε; the present error before any time has passed. The same holds for rmse_m().
  double epsilon_m() const {
    return elapsed_s_ > 0.0 ? error_integral_ / elapsed_s_ : last_error_m_;
  }
  double rmse_m() const {
    return elapsed_s_ > 0.0 ? std::sqrt(square_integral_ / elapsed_s_) : last_error_m_;
  }

 private:
  double elapsed_s_ = 0.0;
  double error_integral_ = 0.0;
  double square_integral_ = 0.0;
  double wall_contact_s_ = 0.0;
  double max_error_m_ = 0.0;
  double last_error_m_ = 0.0;
};

}  // namespace tether
