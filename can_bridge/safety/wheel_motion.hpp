#pragma once

#include <algorithm>
#include <deque>
#include <optional>

#include "common/base/time.hpp"

namespace tether {

/// Knowledge of a wheel's motion. What is missing or old is `unknown`, never zero.
enum class Motion { unknown, standing, turning };

/// Judges one wheel by two witnesses: the speed that its drive reports, and its position counter.
/// One alone can be wrong in a way that looks like standstill: a speed that is only valid while the
/// power stage is on, a wrong scale, an encoder that has come loose. Pure.
///
/// - Turning: a fresh speed of standstill_radps or more, or a fresh position that has moved by more
///   than that speed makes of its window, and one count.
/// - Standing: both are fresh and neither says so, and the positions cover kWindow without a gap.
/// - Unknown: anything else.
///
/// Positions are compared by when they arrived, and not over pauses longer than kLongestPause (or
/// the timeout, if that is longer).
/// Before the first report: unknown.
class WheelMotion {
 public:
  static constexpr Duration kWindow = std::chrono::milliseconds{100};
  /// A round of questions by SDO takes less.
  static constexpr Duration kLongestPause = std::chrono::milliseconds{500};

  /// `count_rad`: one count of the position. `timeout`: age from which a report is not fresh.
  WheelMotion(double standstill_radps, double count_rad, Duration timeout)
      : standstill_radps_(standstill_radps),
        count_rad_(count_rad),
        timeout_(timeout),
        pause_(std::max(timeout, kLongestPause)) {}

  void forget();
  /// The position counter may go on from anywhere.
  void forget_position() { spans_.clear(); }
  void on_speed(double radps, Instant now);
  void on_position(double angle_rad, Instant now);

  Motion judge(Instant now) const { return judge(now, timeout_); }
  /// The judgement of the newest reports, however old they are, if they are of one time.
  Motion newest() const;

  /// The newest speed, if it is fresh.
  std::optional<double> reported_radps(Instant now) const;
  /// The mean speed by position over its window; nullopt if that is not fresh or has one sample.
  std::optional<double> counted_radps(Instant now) const;
  /// The faster of both witnesses, as far as they are fresh; nullopt if neither is.
  std::optional<double> fastest_radps(Instant now) const;

 private:
  /// Positions that came within kThin of each other.
  struct Span {
    Instant from;
    Instant until;
    double low_rad;
    double high_rad;
    double last_rad;
  };
  static constexpr Duration kThin = std::chrono::milliseconds{5};

  Motion by_speed(Instant now, Duration timeout) const;
  Motion by_position(Instant now, Duration timeout) const;
  Motion judge(Instant now, Duration timeout) const;

  double standstill_radps_;
  double count_rad_;
  Duration timeout_;
  Duration pause_;
  std::optional<Instant> speed_stamp_;
  double speed_radps_ = 0.0;
  std::deque<Span> spans_;  // the shortest that cover kWindow
};

}  // namespace tether
