#pragma once

#include <optional>

namespace tether {

/// A run's result in numbers, pure: it receives the distance to the reference at some times, and
/// interpolates linearly.
///
/// ε is the paper's metric: the time-mean of the distance to the reference,
/// ε = 1/(t1 − t0) ∫ ‖p*(t) − p(t)‖ dt, by the trapezoidal rule over the times at which it receives
/// the error. The other numbers are definitions of this project.
class Metrics {
 public:
  /// Settings of [run], which has the same defaults and their reasons.
  struct Settings {
    double settled_from_s = 10.0;
    double lost_beyond_m = 5.0;
    double lost_for_s = 5.0;
  };

  Metrics() : Metrics(Settings{}) {}
  explicit Metrics(const Settings& settings) : settings_(settings) {}

  /// The error at the start, `at_s` after t = 0, before any time has passed.
  void start(double error_m, double at_s = 0.0);

  /// `dt_s` later the error is `error_m`; for `wall_contact_s` of it the vehicle touched a wall.
  void add(double dt_s, double error_m, double wall_contact_s);

  double error_m() const { return last_error_m_; }
  double max_error_m() const { return max_error_m_; }
  double wall_contact_s() const { return wall_contact_s_; }
  /// ε; the present error before any time has passed. The same holds for rmse_m().
  double epsilon_m() const;
  double rmse_m() const;
  /// ∫ ‖p*(t) − p(t)‖ dt so far [m·s].
  double error_integral_m_s() const { return error_integral_; }

  /// ε and the largest error over the time from `settled_from_s` on. Until then both are the
  /// present error, which is where they begin: of a run that ends earlier they are the error at its
  /// end.
  double settled_epsilon_m() const;
  double settled_max_error_m() const;

  /// An excursion is a stretch of time with an error above `lost_beyond_m`, without a break.
  /// Whether one has lasted `lost_for_s` by now: the vehicle was lost, even if it is back.
  bool lost() const { return lost_from_s_.has_value(); }
  /// The time at which the first excursion of that length began; before there is one, the present
  /// time: nothing more is known (a time to an event, censored on the right).
  double lost_from_s() const { return lost_from_s_.value_or(now_s_); }
  /// Time to return: how long the longest excursion lasted of those that are over; 0 if none is.
  double return_s() const { return return_s_; }
  /// How long the present excursion has lasted; 0 if there is none. At the run's end it is a time
  /// to return that was cut off: it would have been at least this.
  double away_s() const { return away_from_s_ ? now_s_ - *away_from_s_ : 0.0; }

 private:
  void add_settled(double dt_s, double error_m);
  void follow_excursion(double dt_s, double error_m);

  Settings settings_;
  double now_s_ = 0.0;
  double elapsed_s_ = 0.0;
  double error_integral_ = 0.0;
  double square_integral_ = 0.0;
  double wall_contact_s_ = 0.0;
  double max_error_m_ = 0.0;
  double last_error_m_ = 0.0;
  double settled_s_ = 0.0;
  double settled_integral_ = 0.0;
  double settled_max_error_m_ = 0.0;
  std::optional<double> away_from_s_;  // the present excursion's begin
  std::optional<double> lost_from_s_;
  double return_s_ = 0.0;
};

}  // namespace tether
