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
    std::int64_t denied = 0;  ///< frames that no bridge sends, or what SDO must not write
    std::int64_t zeroed = 0;  ///< frames whose setpoint was taken out
  };

  explicit TransmitWhitelist(TransmitRules rules) : rules_(std::move(rules)) {}

  /// Whether `frame` may be sent. Unless `may_move`, non-zero setpoints in it are made zero. The
  /// frame itself is still sent, because it may carry a quick stop. SDO never writes a setpoint
  /// other than zero, nor a controlword other than a stop in one frame.
  bool pass(CanFrame& frame, bool may_move);

  const Counters& counters() const { return counters_; }

 private:
  bool initiates_sdo_download(const CanFrame& frame) const;
  bool writes_setpoint_by_sdo(const CanFrame& frame) const;
  bool switches_on_by_sdo(const CanFrame& frame) const;

  TransmitRules rules_;
  Counters counters_;
};

}  // namespace tether
