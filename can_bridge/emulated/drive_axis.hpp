#pragma once

#include <cstdint>

#include "can_bridge/emulated/axis.hpp"
#include "can_bridge/emulated/encoder.hpp"
#include "can_bridge/emulated/objects.hpp"

namespace tether {

/// An axis of an emulated drive with its encoder, as its objects set and show it.
struct EmulatedDriveAxis {
  AxisObjects objects;
  EmulatedAxis machine;
  EmulatedEncoder encoder;
  double coasting_radps2 = 1.0;  ///< deceleration of a wheel without power and brake
  double push_radps2 = 0.0;      ///< a load that accelerates it, forward positive
  double brake_share = 1.0;      ///< acting share of the drive's ramps towards zero

  /// Runs the axis for `dt` with what the objects say.
  void run(const ObjectDictionary& dictionary, Duration dt);

  /// Lets `dt` pass while the drive's firmware does not run.
  void coast(Duration dt);

  /// Updates statusword, error code, mode display, speed and position. `device_error` shows where
  /// the axis has no error of its own.
  void show(ObjectDictionary& dictionary, std::uint16_t device_error) const;

  /// The setpoint as the wheel's angular speed, forward positive.
  double wheel_target_radps() const {
    return machine.setpoint() / objects.target_per_radps * objects.sign;
  }

 private:
  double actual(double units_per_radps) const {
    return encoder.speed_radps() * units_per_radps * objects.sign;
  }
};

}  // namespace tether
