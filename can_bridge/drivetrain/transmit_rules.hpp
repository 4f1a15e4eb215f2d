#pragma once

#include <cstdint>
#include <vector>

#include "can_bridge/bus/object_ref.hpp"

namespace tether {

/// Which frames a bridge may send, and where in them setpoints are. A profile derives it from the
/// drivetrain's description alone, never from its own state: TransmitWhitelist checks every frame
/// of the profile against them.
struct TransmitRules {
  struct Frame {
    std::uint32_t id = 0;
    std::uint8_t setpoint_mask = 0;  ///< bit n: data byte n is part of a setpoint
    bool extended = false;           ///< `id` has 29 bits
  };
  std::vector<Frame> frames;           ///< no other identifier may be sent
  std::vector<ObjectRef> setpoints;    ///< objects that only RPDOs may write
  std::vector<std::uint32_t> sdo_ids;  ///< 11-bit frames with which they could be written by SDO
  /// Objects that SDO may write with `stop_words` only: drives are switched on by RPDOs alone.
  std::vector<ObjectRef> controlwords{};
  std::vector<std::uint32_t> stop_words{};
};

}  // namespace tether
