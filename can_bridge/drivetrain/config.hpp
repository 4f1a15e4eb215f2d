#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/drivetrain/safety_input.hpp"
#include "common/base/time.hpp"

namespace tether {

/// How drives stop a vehicle whose bridge or bus is dead.
struct OwnStop {
  /// Deceleration of the weaker wheel's rim; nullopt if the drivetrain file sets no ramp.
  std::optional<double> mps2{};
  /// Time from the last setpoint until the later wheel brakes.
  Duration deadline = std::chrono::milliseconds{100};
};

/// Common part of every drivetrain's description, whatever its profile. Each profile's own
/// description derives from it (cia402/config.hpp, agilex/config.hpp).
struct DrivetrainCommon {
  std::string name;                         ///< for people
  std::uint16_t feedback_timeout_ms = 100;  ///< age of a wheel's feedback that stops the vehicle
  std::uint16_t boot_timeout_ms = 2000;     ///< from reset to the first sign of life
  std::uint16_t step_timeout_ms = 1000;     ///< for each change of a drive's state
  double standstill_radps = 0.05;           ///< wheels slower than this stand
  std::vector<SafetyInputConfig> safety_inputs;
};

}  // namespace tether
