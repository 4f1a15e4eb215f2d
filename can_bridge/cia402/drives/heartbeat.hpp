#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/canopen/canopen.hpp"
#include "common/base/time.hpp"

namespace tether::cia402 {

/// The bridge's own heartbeat, by which the drives watch over it.
class HeartbeatProducer {
 public:
  HeartbeatProducer(std::uint8_t node, Duration period) : node_(node), period_(period) {}

  /// Sends one if it is due: the period is rounded up to ticks.
  void tick(Instant now, std::vector<CanFrame>& out) {
    if (next_ && now + kSlack < *next_) return;
    next_ = now + period_;
    out.push_back(canopen::heartbeat_frame(node_, canopen::NmtState::operational));
    ++beats_;
  }

  /// How many were sent since restart_count().
  int beats() const { return beats_; }
  void restart_count() { beats_ = 0; }

 private:
  // Ticks may come a little early. Without this slack, such a heartbeat would wait for the next
  // tick and come a whole cycle late.
  static constexpr Duration kSlack = std::chrono::milliseconds(1);

  std::uint8_t node_;
  Duration period_;
  std::optional<Instant> next_;
  int beats_ = 0;
};

}  // namespace tether::cia402
