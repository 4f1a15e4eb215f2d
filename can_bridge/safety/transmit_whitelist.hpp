#pragma once

#include <cstdint>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/drivetrain/config.hpp"

namespace tether {

/// The last line of defence between a drive profile and the bus. It knows from the drivetrain's
/// description alone, not from the profile, which frames a bridge may send and where in them the
/// setpoints are; everything else is denied.
///
/// - cia402: NMT (0x000), SYNC (0x080), the bridge's heartbeat (0x700 + master), SDO requests
///   (0x600 + node) and the configured RPDOs. Setpoints are the axes' target_velocity objects in
///   RPDOs and SDO downloads.
/// - agilex_v2: 0x111 (motion, setpoints in its bytes 0…7), 0x421 (control mode), 0x441 (clear
///   errors).
class TransmitWhitelist {
 public:
  struct Counters {
    std::int64_t denied = 0;  ///< frames that no bridge sends, or a setpoint by SDO
    std::int64_t zeroed = 0;  ///< frames whose setpoint was taken out
  };

  explicit TransmitWhitelist(const DrivetrainConfig& config);

  /// Whether `frame` may be sent. Unless `may_move`, non-zero setpoints in it are made zero: the
  /// frame itself still goes, for a quick stop may travel in it.
  bool pass(CanFrame& frame, bool may_move);

  const Counters& counters() const { return counters_; }

 private:
  struct Allowed {
    std::uint32_t id;
    std::uint8_t setpoint_mask;  ///< bit n: data byte n is part of a setpoint
  };
  bool writes_setpoint_by_sdo(const CanFrame& frame) const;
  void allow_cia402(const DrivetrainConfig& config);

  std::vector<Allowed> allowed_;
  std::vector<ObjectRef> setpoints_;
  std::vector<std::uint32_t> sdo_ids_;
  Counters counters_;
};

}  // namespace tether
