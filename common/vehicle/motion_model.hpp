#pragma once

#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/small_angle.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Known errors of a drive in following its commands (estimated by
/// controller/laws/pose_filter.hpp). The default is a drive without errors.
struct DriveModel {
  double rim_scale = 1.0;   ///< rims are faster than commanded by this factor: larger wheels
  double turn_scale = 1.0;  ///< and differ from each other by this factor more: a narrower track
  double lag_s = 0.0;       ///< time constant, first order, of the rims' targets
  /// Added to what the wheels do while they turn or should: slopes, drag, slip.
  double v_bias_mps = 0.0;
  double omega_bias_radps = 0.0;

  bool operator==(const DriveModel&) const = default;
};

/// Controllers' model of a vehicle's response to a commanded twist: two rolling
/// wheels, each of which moves to its commanded rim speed at a limited acceleration. No masses, no
/// slip, no walls. With a DriveModel the rim speeds aimed at are
///   rim_scale · (v ∓ turn_scale · ω · track/2), behind a low-pass L' = (target − L)/lag.
class MotionModel {
 public:
  struct Limits {
    double track_m = 1.2;
    double max_wheel_acceleration_mps2 = 3.0;
    double max_wheel_speed_mps = 10.0;  ///< both wheels are scaled together
  };
  struct State {
    Pose2 pose;
    WheelSpeeds rim;
    WheelSpeeds lagging{};  ///< present target of the rims
  };
  /// With a lag, or in steps of a filter, no step is longer.
  static constexpr double kShort_s = 0.01;

  explicit MotionModel(const Limits& limits, const DriveModel& drive = {})
      : limits_(limits),
        drive_(drive),
        ideal_(drive == DriveModel{}),
        turn_per_m_(1.0 / limits.track_m),
        s_per_mps_(1.0 / limits.max_wheel_acceleration_mps2) {}

  /// Moves for `dt_s` ≥ 0 with `command` in force throughout. The distance that each wheel rolls is
  /// exact; the path is the arc of the mean speeds, off by at most
  /// dt³/12 · (|v| |dω/dt| + |ω| |dv/dt|). A lag is stepped by kShort_s at most (backward Euler).
  void advance(State& state, const Twist& command, double dt_s) const {
    Heading heading = Heading::of(state.pose.yaw_rad);
    advance(state, heading, command, dt_s);
  }
  /// The same where `heading`, the pose's, is known; it is kept.
  void advance(State& state, Heading& heading, const Twist& command, double dt_s) const;

  /// The twist that `command` leads to from `rim` within `dt_s`: all that the limits allow of it.
  Twist reachable(const WheelSpeeds& rim, const Twist& command, double dt_s) const;

  /// The same as reachable(), command_for() and advance() in turn; returns the command.
  Twist pursue(State& state, Heading& heading, const Twist& wish, double dt_s) const;

  /// The command that makes the vehicle do `wish`, at the latest at the end of `dt_s`: the inverse
  /// of the DriveModel. A lag is led by four times the change at most.
  Twist command_for(const State& state, const Twist& wish, double dt_s) const;

  Twist twist(const State& state) const { return to_twist(state.rim, limits_.track_m); }
  WheelSpeeds rim_of(const Twist& twist) const { return to_wheel_speeds(twist, limits_.track_m); }
  const Limits& limits() const { return limits_; }
  const DriveModel& drive() const { return drive_; }

 private:
  WheelSpeeds target_of(const Twist& command) const;
  void roll_to(State& state, Heading& heading, const WheelSpeeds& target, double dt_s) const;
  double roll(double& speed_mps, double target_mps, double dt_s) const;
  void move(State& state, Heading& heading, double left_m, double right_m, double dt_s) const;
  void step_with_lag(State& state, Heading& heading, const WheelSpeeds& target, double dt_s) const;

  Limits limits_;
  DriveModel drive_;
  bool ideal_;
  double turn_per_m_, s_per_mps_;  // products are faster than quotients
};

}  // namespace tether
