#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace tether {

class DrivetrainFile;

/// A line of a GPIO character device (libgpiod). Clear is high, or low with active_low; it is
/// biased towards stop where the chip can do that.
struct GpioInputWiring {
  std::string chip;  ///< "gpiochip0", "/dev/gpiochip0" or its label
  unsigned line = 0;
  bool active_low = false;
};

/// A CAN frame with an 11-bit identifier. Bits `mask` of byte `byte` are `clear`, or the vehicle
/// stops. If `stop` is given, whatever is neither of the two contradicts itself.
struct CanInputWiring {
  std::uint32_t id = 0;
  std::uint8_t length = 1;  ///< bytes of the frame
  std::uint8_t byte = 0;
  std::uint8_t mask = 0xFF;
  std::uint8_t clear = 0;  ///< not 0
  std::optional<std::uint8_t> stop{};
  std::uint16_t timeout_ms = 100;  ///< a silence that means stop
};

/// A signal of the vehicle's own that stops or slows it: a scanner's field, a bumper, the auxiliary
/// contact of the e-stop chain. A [[safety_input]] of the drivetrain's file, whatever its profile:
/// it says how the vehicle is wired, which no experiment changes.
///
/// All are fail-safe: the signal is there while all is well ("clear"), so that an open wire, a dead
/// sender and zeros mean stop.
struct SafetyInputConfig {
  enum class Function {
    protective_stop,  ///< the vehicle stops
    speed_limit,      ///< no rim is to move faster than speed_limit_mps
    estop_status,     ///< like a pressed ESTOP: latched
  };
  /// Reaction of protective_stop without restart_after_s. Then the vehicle is disarmed.
  enum class Reaction { quick_stop, ramp };

  using Gpio = GpioInputWiring;
  using Can = CanInputWiring;

  std::string name;  ///< for reasons and counters
  Function function = Function::protective_stop;
  Reaction reaction = Reaction::quick_stop;
  /// protective_stop: stays armed, and goes on when it has been clear for this long, 2 s or more;
  /// nullopt: never by itself.
  std::optional<double> restart_after_s{};
  double speed_limit_mps = 0.0;
  std::variant<Can, Gpio> wiring{};
};

/// The [[safety_input]]s of a drivetrain's file. Throws UsageError.
std::vector<SafetyInputConfig> read_safety_inputs(const DrivetrainFile& file);

}  // namespace tether
