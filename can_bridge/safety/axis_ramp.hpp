#pragma once

namespace tether {

/// One quantity (a speed) that follows a target within limits on its rate of change and on the
/// change of that rate, cycle by cycle. The mean rate within cycle k is a(k); the limits are
/// |a| ≤ acceleration away from zero, |a| ≤ deceleration towards zero (a cycle that crosses zero
/// counts as acceleration), and |a(k) − a(k−1)| ≤ jerk · cycle.
///
/// Time-optimal for a constant target and exact in discrete time: it chooses the largest rate from
/// which steps of jerk · cycle back to zero still end on the target. So it arrives without
/// overshoot and stays there, whatever the limits. Only a target that jumps too near to take the
/// rate back in time is overshot, by as little as the jerk allows.
class AxisRamp {
 public:
  struct Limits {
    double acceleration = 1.0;
    double deceleration = 1.0;  ///< ≥ acceleration
    double jerk = 1.0;
    double stop_jerk = 1.0;  ///< while stopping: ≥ jerk
  };
  /// Limits for one cycle, where this axis may do less than its own limits allow.
  struct Share {
    double rate = 0.0;       ///< largest rate towards the target
    double rate_step = 0.0;  ///< largest change of the rate that is planned with
  };

  /// All limits > 0 and finite, cycle_s > 0.
  AxisRamp(const Limits& limits, double cycle_s);

  /// Rests at `value`.
  void reset(double value);

  /// The limits alone, for a step towards `target`.
  Share limits_towards(double target, bool stopping) const;

  /// One cycle towards `target`. `stopping`: with stop_jerk, with which a brake that was applied so
  /// is also released.
  void step(double target, const Share& share, bool stopping);

  double value() const { return value_; }
  double rate() const { return rate_; }
  /// The value at which it comes to rest if its rate is taken back from now on.
  double resting_value() const;
  /// The larger of |value| and |resting value|.
  double occupied() const;

 private:
  double release_step() const { return releasing_ ? stop_step_ : step_; }

  Limits limits_;
  double cycle_s_;
  double step_;       ///< jerk · cycle: largest change of the rate
  double stop_step_;  ///< the same while stopping
  double value_ = 0.0;
  double rate_ = 0.0;
  bool releasing_ = false;  ///< the rate was built up with stop_jerk and may be taken back with it
};

}  // namespace tether
