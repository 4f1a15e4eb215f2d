#pragma once

#include <cstdint>
#include <utility>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/drivetrain/transmit_rules.hpp"

namespace tether {

/// The last line of defence between a drive profile and the bus: what the rules do not allow is
/// denied.
class TransmitWhitelist {
 public:
  struct Counters {
    std::int64_t denied = 0;  ///< frames that no bridge sends, or a setpoint by SDO
    std::int64_t zeroed = 0;  ///< frames whose setpoint was taken out
  };

  explicit TransmitWhitelist(TransmitRules rules) : rules_(std::move(rules)) {}

  /// Whether `frame` may be sent. Unless `may_move`, non-zero setpoints in it are made zero. The
  /// frame itself is still sent, because it may carry a quick stop.
  bool pass(CanFrame& frame, bool may_move);

  const Counters& counters() const { return counters_; }

 private:
  bool writes_setpoint_by_sdo(const CanFrame& frame) const;

  TransmitRules rules_;
  Counters counters_;
};

}  // namespace tether
