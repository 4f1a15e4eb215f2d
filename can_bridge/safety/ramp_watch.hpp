#pragma once

#include <deque>
#include <optional>
#include <utility>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Notices a vehicle that shall come to rest by its setpoints' ramp, and does not brake. From
/// kGrace after the beginning on, speed and yaw rate must each have fallen at half of the
/// configured deceleration or more, or be no faster than the setpoint of kGrace ago: where the
/// curve is kept, one of both brakes less than it might. Pure.
class RampWatch {
 public:
  static constexpr Duration kGrace = std::chrono::milliseconds{150};

  /// Both decelerations as configured, > 0.
  RampWatch(double deceleration_mps2, double yaw_deceleration_radps2)
      : deceleration_mps2_(deceleration_mps2), yaw_deceleration_radps2_(yaw_deceleration_radps2) {}

  /// No ramp is under way.
  void end() {
    since_.reset();
    told_.clear();
  }
  /// Once per cycle of a ramp, with the setpoint and the twist that the wheels have: whether it
  /// brakes.
  bool brakes(Instant now, const Twist& setpoint, const Twist& measured);

 private:
  double deceleration_mps2_;
  double yaw_deceleration_radps2_;
  std::optional<Instant> since_;
  Twist from_;
  std::deque<std::pair<Instant, Twist>> told_;  // setpoints of the last kGrace, and one before
};

}  // namespace tether
