#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "can_bridge/cia402/drives/drives.hpp"
#include "can_bridge/cia402/profile/fault_latch.hpp"

namespace tether::cia402 {

/// The stage `stopping`: quick stop until both wheels stand, then power stages off.
class Stopping {
 public:
  explicit Stopping(Drives& drives) : d_(drives) {}

  /// `disable` brakes, too, if the wheels are not known to stand.
  void begin(StopKind kind);
  /// Enters `standby` when both power stages are off. A quick stop that takes longer than 5 s stays
  /// commanded and says so in the reason; a power stage that stays on is a fault.
  std::optional<Fault> tick(Instant now);
  std::uint16_t controlword(std::size_t i) const;

 private:
  void brake(Instant now);
  std::string overdue_text(Instant now) const;

  Drives& d_;
  StopKind kind_ = StopKind::quick;
  bool braking_ = false;  // before the power stages go off
};

}  // namespace tether::cia402
