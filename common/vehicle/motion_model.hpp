#pragma once

#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// What a vehicle does with a commanded twist, as far as controllers predict it: two rolling
/// wheels, each of which moves to its commanded rim speed at a limited acceleration. No masses, no
/// slip, no walls.
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
  };

  explicit MotionModel(const Limits& limits) : limits_(limits) {}

  /// Moves for `dt_s` ≥ 0 with `command` in force throughout. The distance that each wheel rolls is
  /// exact; the path is the arc of the mean speeds, off by at most
  /// dt³/12 · (|v| |dω/dt| + |ω| |dv/dt|).
  void advance(State& state, const Twist& command, double dt_s) const;

  /// The twist that `command` leads to from `rim` within `dt_s`: all that the limits allow of it.
  Twist reachable(const WheelSpeeds& rim, const Twist& command, double dt_s) const;

  Twist twist(const State& state) const { return to_twist(state.rim, limits_.track_m); }
  WheelSpeeds rim_of(const Twist& twist) const { return to_wheel_speeds(twist, limits_.track_m); }
  const Limits& limits() const { return limits_; }

 private:
  Limits limits_;
};

}  // namespace tether
