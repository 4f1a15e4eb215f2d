#pragma once

#include <cstdint>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/cia402/pdo.hpp"

namespace tether::cia402 {

/// Who may send an identifier on the drivetrain's bus, and what it means there (CiA 301, 7.3.3).
struct Sender {
  enum class Kind {
    other,  ///< nothing to do with this drivetrain
    // Only the bridge may send these. Another sender of one is an intruder.
    nmt,
    sync,
    master_heartbeat,
    setpoint,     ///< RPDO 1…4 of a drive, whether mapped or not
    sdo_request,  ///< tools may read objects, too
    // The drives send these.
    sdo_response,
    heartbeat,
    emergency,
    feedback,  ///< a TPDO of the configuration
  };
  Kind kind = Kind::other;
  std::uint8_t node = 0;  ///< node of the drive, where one is meant
};

/// Meaning of `id` to a drivetrain.
Sender sender_of(std::uint32_t id, const Cia402Config& config, const PdoMap& pdos);

/// All identifiers whose sender is not `other`.
std::vector<CanFilter> drivetrain_filters(const Cia402Config& config, const PdoMap& pdos);

}  // namespace tether::cia402
