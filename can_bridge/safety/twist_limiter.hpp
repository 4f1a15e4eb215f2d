#pragma once

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"

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

/// Limits of the vehicle. All > 0; a deceleration is never below its acceleration (asserted:
/// the scenario loader refuses such files).
struct TwistLimits {
  double max_speed_mps = 3.0;
  double max_reverse_mps = 3.0;
  double max_yaw_rate_radps = 2.0;
  double max_acceleration_mps2 = 1.0;
  double max_deceleration_mps2 = 1.5;
  double max_yaw_acceleration_radps2 = 2.0;
  double max_yaw_deceleration_radps2 = 3.0;
  double max_jerk_mps3 = 30.0;
  double max_yaw_jerk_radps3 = 60.0;
  double max_wheel_speed_mps = 10.0;  ///< rim speed
  double track_m = 1.2;
  Duration cycle = std::chrono::milliseconds{20};
};

/// The limits of [can] and [vehicle] of a scenario.
TwistLimits twist_limits(const Sections<VehicleSettings, CanSettings>& settings);

/// Turns body twists as commanded into twists that the vehicle may follow, one per control cycle.
///
/// - A target beyond the limits of speed, yaw rate or wheel speed is scaled as a whole: v and ω by
///   one factor, so that the vehicle goes the commanded curve, slower.
/// - Changes of v and ω towards the target share one factor too: from rest both rise and arrive
///   together, in proportion, as fast as the tighter of the two axes' limits allows. Curvature thus
///   blends from one command to the next instead of the slower axis dragging behind. Braking does
///   not wait for the curve: a speed that falls falls as if the target had no yaw, and a yaw rate
///   that falls while the speed does not falls as if that stayed.
/// - Acceleration, deceleration (towards zero) and jerk limits hold in every cycle, see AxisRamp.
///   Wheel speed too, also on the way between two targets: an axis waits for the other to make
///   room.
/// - A constant target is reached without overshoot and then held. From rest it takes 1/F + F/G
///   seconds, give or take one cycle, or 2/√G where F² ≥ G, with F = min(A/|d|) and G = min(J/|d|)
///   over both axes (d: the change, A and J: the axis's acceleration and jerk).
///
/// stop() is for ramps to zero that must not be late: the jerk limit may delay them by at most
/// kStopJerkDelay, and is exceeded where it would delay them more. Zero is reached after at most
/// max(|v|/deceleration, |ω|/yaw deceleration) + kStopJerkDelay and two cycles, whatever went
/// before.
class TwistLimiter {
 public:
  explicit TwistLimiter(const TwistLimits& limits);

  /// Jerk while stopping is at least (1.5·A + D)/kStopJerkDelay. Taking back an acceleration A at
  /// jerk J takes A/J and adds A²/(2J) of speed (A²/(2JD) ≤ A/(2J) of time); building up and
  /// releasing the brake D costs D/J.
  static constexpr Duration kStopJerkDelay = std::chrono::milliseconds{100};

  /// Rests at zero.
  void reset();

  /// One cycle towards `target` (finite).
  Twist step(const Twist& target);
  /// The same, but as fast as stop(): for a target that may not wait for the jerk limit.
  Twist brake_to(const Twist& target);
  /// One cycle towards zero.
  Twist stop();

  Twist twist() const { return {v_.value(), omega_.value()}; }
  bool at_rest() const;

  /// `target` scaled to the limits of speed, yaw rate and wheel speed.
  Twist within_speed_limits(const Twist& target) const;

 private:
  Twist advance(const Twist& target, bool stopping);

  TwistLimits limits_;
  double half_track_m_;
  AxisRamp v_;
  AxisRamp omega_;
};

}  // namespace tether
