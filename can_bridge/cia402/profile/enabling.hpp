#pragma once

#include <array>
#include <optional>

#include "can_bridge/cia402/profile/drives.hpp"
#include "can_bridge/cia402/profile/fault_latch.hpp"

namespace tether::cia402 {

/// The stage `enabling`: up to OperationEnabled, each step within step_timeout_ms. Falling back
/// from there before the other axis has arrived is a fault, too.
class Enabling {
 public:
  explicit Enabling(Drives& drives) : d_(drives) {}

  void begin();
  /// Enters `enabled` when both axes have arrived.
  std::optional<Fault> tick(Instant now);

 private:
  Drives& d_;
  std::array<int, 2> climbed_{};  // highest state reached
  std::array<Instant, 2> climbed_at_{};
};

}  // namespace tether::cia402
