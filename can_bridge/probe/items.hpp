#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/cia402/config.hpp"

namespace tether {

/// One object that `tether can probe` reads.
struct ProbeItem {
  /// How its value is shown.
  enum class Kind {
    number,
    text,
    device_type,
    identity,
    statusword,
    supported_modes,
    heartbeat_consumer,
    milliseconds,
    error_code,
    cob_id,
    mapping,
  };
  /// Meaning of its absence.
  enum class Need {
    quiet,     ///< nothing: the row is left out
    info,      ///< worth knowing
    optional,  ///< the drivetrain file can do without
    required,  ///< the drivetrain file does not fit this drive
  };

  ObjectRef object;  ///< bytes = 0: any size
  std::string name;
  Kind kind = Kind::number;
  Need need = Need::info;
  std::optional<std::int64_t> wanted;  ///< value that the file writes, or expects
  bool must_equal = false;             ///< else another value is no fault: start-up writes it
};

/// Objects to read from `node`: identity, errors, mode and watchdogs of any CiA 402 drive, and with
/// `config` each object that its file mentions for this node. Each object once.
std::vector<ProbeItem> probe_items(std::uint8_t node, const Cia402Config* config);

/// Objects that identify a node: device type (which every CANopen device has), vendor, product
/// code.
std::vector<ProbeItem> scan_items();

/// A value as people read it: "0x00020192 (CiA 402 drive)".
std::string probe_value(const ProbeItem& item, const std::vector<std::uint8_t>& bytes);

}  // namespace tether
