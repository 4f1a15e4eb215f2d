#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {

/// Profile velocity, IEC 61800-7-201 mode of operation.
inline constexpr std::int64_t kProfileVelocity = 3;

/// One step of a drive's configuration: write an object, read one back, or both.
struct SdoStep {
  enum class Check {
    none,              ///< nothing is read
    equal,             ///< the read value must be `expected` in the bits of `mask`
    eventually_equal,  ///< the same, read again until step_timeout_ms is over
    drive_profile,     ///< must be a CiA 402 device type, or 0 (not told)
    keep,              ///< the read value, in the bits of `mask`, stays set in later writes
  };
  enum class Need {
    required,  ///< if it is aborted or reads another value, the drive cannot be used
    optional,  ///< then: it is noted, and start-up goes on
    watchdog,  ///< then: start-up goes on, but one watchdog of the node must succeed
    later,     ///< if it reads 0: start-up goes on, and it must be right when enabled
  };

  ObjectRef object;
  std::optional<std::int64_t> write;
  Check check = Check::none;
  ObjectRef read_back;  ///< where check is not `none`
  std::int64_t expected = 0;
  std::uint32_t mask = 0xFFFFFFFF;
  Need need = Need::required;
  std::string meaning;  ///< "heartbeat consumer": for reasons
};

/// Everything that start-up does to `node` after its boot-up message, in this order: device type,
/// watchdogs, heartbeat producer (0x1017), the watchdogs' reactions, setup objects, PDOs, mode of
/// operation. A PDO is switched off, cleared, mapped, counted, timed and switched on (CiA
/// 301, 7.5.2.36), then all of it is read back; one that is `preset` is only read back, except for
/// its event timer. Bit 30 of its identifier (no remote requests) stays as the drive has it.
///
/// Some drives show no mode of operation (0) until they are enabled: where a TPDO carries it,
/// start-up goes on without it (Need::later).
std::vector<SdoStep> startup_steps(const Cia402Config& config, std::uint8_t node);

/// Whether a write to `index` of `node` could change how its drive is watched over, limited or
/// commanded: what start-up writes or checks, any PDO parameter, controlword, target velocity.
bool is_vital(const Cia402Config& config, std::uint8_t node, std::uint16_t index);

}  // namespace tether::cia402
