#pragma once

#include "onboard/autonomy/onboard_driver.hpp"

namespace tether::test {

/// Faults of a driver, for trials that must detect them.
enum class Fault {
  none,
  starts_early,       ///< the law drives before t = 0
  jumps,              ///< a setpoint is farther from the one before than limits allow
  rolls_on,           ///< it goes on without a driver
  two_drivers,        ///< law and remote driver take turns while it moves
  law_unasked,        ///< the law drives in a protective stop
  remote_unasked,     ///< a remote driver drives before he has taken over
  remote_forever,     ///< the last command counts for ever
  remote_fast,        ///< remote_speed is forgotten
  stops_late,         ///< the wheels heed a protective stop half a second late
  sees_no_obstacles,  ///< the scan shows walls alone
};

/// A driver with such a fault: spoils what the vehicle's own driver says.
class FaultyDriver {
 public:
  FaultyDriver(Fault fault, const AutonomySettings& limits, double step_s)
      : fault_(fault),
        most_mps_(limits.deceleration_mps2 * step_s),
        most_radps_(limits.yaw_acceleration_radps2 * step_s) {}

  Fault fault() const { return fault_; }
  /// `out` of a step.
  void spoil(Instant now, OnboardDriver::Output& out);
  /// Setpoint of the wheels for `setpoint`.
  Twist wheels(Instant now, const OnboardDriver::Output& out);

 private:
  void spoil_law(Instant now, OnboardDriver::Output& out);
  void spoil_remote(OnboardDriver::Output& out);
  Twist nearer(const Twist& target) const;

  Fault fault_;
  double most_mps_, most_radps_;
  Twist before_;
  bool began_ = false;
  bool turn_ = false;
  Instant stopping_ = Instant::max();  ///< since when
  Twist told_;
};

}  // namespace tether::test
