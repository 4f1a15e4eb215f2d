#pragma once

#include "autonomy/field/swept_way.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// The setpoint that the drives get: it never jumps, also when the driver changes. Pure.
///
/// From one step to the next v changes by at most a·dt and ω by at most α·dt. Where it has to
/// become slower than it is, v and ω shrink by one factor, so that the vehicle stays on the arc
/// that its stopping field was swept along; |v| then falls at a, or slower where ω takes longer.
class Setpoint {
 public:
  struct Limits {
    double acceleration_mps2 = 1.0;        ///< a > 0
    double yaw_acceleration_radps2 = 2.0;  ///< α > 0; at least a/reach, or the field is too short
  };

  Setpoint(const Limits& limits, const Outline& outline) : limits_(limits), outline_(outline) {}

  /// One step of `dt_s` towards `target` (finite), with a pace (pace_mps) of at most `allowed_mps`
  /// ≥ 0 as soon as the limits let it.
  Twist step(const Twist& target, double allowed_mps, double dt_s);

  const Twist& twist() const { return twist_; }
  bool stands() const { return twist_.v_mps == 0.0 && twist_.omega_radps == 0.0; }

 private:
  Twist braked(double dt_s, double least_share) const;
  Twist nearer(const Twist& target, double allowed_mps, double dt_s) const;

  Limits limits_;
  Outline outline_;
  Twist twist_;
};

/// `twist` on its curve, with a pace of at most `allowed_mps`.
Twist slowed_to(const Twist& twist, const Outline& outline, double allowed_mps);

}  // namespace tether
