#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {

// Objects that a drive's stop depends on (IEC 61800-7-201).

/// Value that the file writes to the quick stop option code (0x605A) of axis `i`; nullopt: nothing.
std::optional<std::int64_t> quick_stop_option(const Cia402Config& config, std::size_t i);

/// The ramp of the quick stop of axis `i` as the file sets it, wheel rad/s²: 0x6085, or 0x6084 with
/// option code 1 or 5, in units of target_velocity per second. Infinity: the file sets none.
double stop_ramp_radps2(const Cia402Config& config, std::size_t i);

/// How a write to an object changes a stop.
enum class StopPart {
  none,
  quick_stop,  ///< option codes and quick stop deceleration: stops by setpoint do not need it
  other,       ///< profile deceleration, polarity, gear, watchdogs: a quick stop does not need it
  pdo,         ///< PDO parameters: stops by SDO do not need it
};
/// Stop part of this index, independent of the drivetrain file. Axes at +0x800 included.
StopPart stop_part(std::uint16_t index);

}  // namespace tether::cia402
