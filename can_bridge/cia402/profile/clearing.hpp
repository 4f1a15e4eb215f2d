#pragma once

#include <cstdint>
#include <optional>

#include "can_bridge/cia402/drives/drives.hpp"
#include "can_bridge/cia402/profile/fault_latch.hpp"

namespace tether::cia402 {

/// The stage `clearing`: resets the drives' faults with a rising edge of controlword bit 7.
class Clearing {
 public:
  explicit Clearing(Drives& drives) : d_(drives) {}

  void begin();
  /// Enters `settling` when no axis is in Fault any more. A fault that stays is reported again.
  std::optional<Fault> tick(Instant now);
  /// The controlword for an axis in Fault.
  std::uint16_t controlword() const;

 private:
  Drives& d_;
  bool edge_ = false;  // controlword bit 7 is set
};

}  // namespace tether::cia402
