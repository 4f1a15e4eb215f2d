#pragma once

#include <cmath>
#include <cstdint>

namespace tether {

/// An incremental encoder between a wheel and its drive; counts from where it was switched on.
class EmulatedEncoder {
 public:
  /// Tells how the wheel is now. The first call only tells where it stands, because the encoder
  /// counts motion.
  void turn(double angle_rad, double speed_radps) {
    const double moved_rad = known_ ? angle_rad - wheel_rad_ : 0.0;
    known_ = true;
    wheel_rad_ = angle_rad;
    const double seen = frozen_ ? 0.0 : 1.0 - slip_;
    angle_rad_ += moved_rad * seen;
    speed_radps_ = speed_radps * seen;
  }

  /// Power-on: counts from zero.
  void restart() { angle_rad_ = 0.0; }

  /// Frozen: the position stands still and the speed reads zero, as with a broken encoder cable.
  /// What the wheel does meanwhile is lost for good.
  void set_frozen(bool frozen) {
    frozen_ = frozen;
    if (frozen) speed_radps_ = 0.0;
  }
  /// The share of the wheel's motion, 0…1, that does not reach the encoder.
  void set_slip(double share) { slip_ = share; }

  double speed_radps() const { return speed_radps_; }
  /// Nearest count. The caller's register wraps.
  std::int64_t counts(double counts_per_radian) const {
    return std::llround(angle_rad_ * counts_per_radian);
  }

 private:
  bool known_ = false;
  bool frozen_ = false;
  double slip_ = 0.0;
  double wheel_rad_ = 0.0;
  double angle_rad_ = 0.0;
  double speed_radps_ = 0.0;
};

}  // namespace tether
