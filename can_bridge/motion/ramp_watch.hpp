#pragma once

#include <optional>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Notices a vehicle that shall come to rest by its setpoints' ramp, and does not brake. From
/// kGrace after the beginning on, speed and yaw rate must each have fallen at half of the
/// configured deceleration or more. Pure.
class RampWatch {
 public:
  static constexpr Duration kGrace = std::chrono::milliseconds{150};

  /// As configured, > 0.
  RampWatch(double deceleration_mps2, double yaw_deceleration_radps2)
      : deceleration_mps2_(deceleration_mps2), yaw_deceleration_radps2_(yaw_deceleration_radps2) {}

  /// No ramp is under way.
  void end() { since_.reset(); }
  /// Once per cycle of a ramp, with the twist that the wheels have: whether it brakes.
  bool brakes(Instant now, const Twist& measured);

 private:
  double deceleration_mps2_;
  double yaw_deceleration_radps2_;
  std::optional<Instant> since_;
  Twist from_;
};

}  // namespace tether
