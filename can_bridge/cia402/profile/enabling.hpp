#pragma once

#include <array>
#include <optional>
#include <vector>

#include "can_bridge/cia402/drives/drives.hpp"
#include "can_bridge/cia402/profile/fault_latch.hpp"

namespace tether::cia402 {

/// The stages `verifying` and `enabling`.
///
/// First every object that start-up wrote or checked and that read as it should then (watchdogs and
/// their reactions, heartbeat producer, [[setup]], PDOs) is read again. Another value, an abort or
/// no answer is a fault, and reset_fault() configures the drives again. One object of each node is
/// read in a control cycle, all nodes at once: 26 objects, and so 0.52 s at 20 ms, with
/// drivetrains/two_node_cia402.toml. An answer that stays away ends it after (sdo_retries + 1) ·
/// sdo_timeout_ms.
///
/// Then up to OperationEnabled, each step within step_timeout_ms. Falling back from there before
/// the other axis has arrived is a fault, too, and so is a drive that does not show profile
/// velocity within feedback_timeout_ms from there.
class Enabling {
 public:
  explicit Enabling(Drives& drives) : d_(drives) {}

  void begin();
  /// Enters `enabled` when both axes have arrived. SDO requests go to `service`.
  std::optional<Fault> tick(Instant now, std::vector<CanFrame>& service);

 private:
  std::optional<Fault> verify(Instant now, std::vector<CanFrame>& service);
  std::optional<Fault> climb(Instant now);

  Drives& d_;
  std::array<int, 2> climbed_{};  // highest state reached
  std::array<Instant, 2> climbed_at_{};
};

}  // namespace tether::cia402
