#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/cia402/drives.hpp"
#include "can_bridge/cia402/fault_latch.hpp"

namespace tether::cia402 {

/// Sees to it that a stop reaches drives that do not take it by PDO: ones that are not operational
/// (CiA 301, 7.3.2.2: then there are no PDOs), or do not do what their RPDOs say.
///
/// It acts from the first tick of a stop until the drives report that their power is off and their
/// wheels stand. A node that is not known to be operational, whose TPDOs stay away, or that has not
/// confirmed its stop after 100 ms repeatedly gets the same controlword by SDO, and is asked for
/// statusword and speed. A node that says that it is in NMT "stopped", where SDO is dead, too, is
/// commanded to pre-operational every 100 ms.
///
/// A stop is confirmed by a statusword from after it (QuickStopActive, power off, or a fault), or
/// by a wheel that stands. If it is not after confirmation_time(), the bridge's heartbeat, SYNC and
/// that node's setpoints are withheld until it is, so that the drive's own watchdog stops it. That
/// goes on after a reset_fault(), and begins in a bridge that has just started and hears a running
/// drive, until the drive obeys, stands or is reset; answers that refuse do not count. One
/// that has no heartbeat consumer, but a vendor's watchdog, gets no SDO either for as long as this
/// takes and 100 ms.
class StopAssurance {
 public:
  explicit StopAssurance(Drives& drives) : d_(drives) {}

  /// 200 ms, or twice feedback_timeout_ms if that is longer.
  Duration confirmation_time() const;

  /// In every tick, before anything is sent. A stop that is not confirmed in time is a fault.
  std::optional<Fault> tick(Instant now, std::vector<CanFrame>& nmt);
  /// Once the controlwords of this tick are commanded.
  void send_by_sdo(Instant now, std::vector<CanFrame>& service);

  /// Whether heartbeat and SYNC must not be sent; and: the setpoints of this node.
  bool withholds() const;
  static bool withholds_from(const Node& node) { return node.unconfirmed; }
  /// For reasons; "" while nothing is withheld.
  std::string text() const;

  /// A stop is under way, as of the last tick.
  bool stopping() const { return since_.has_value(); }
  std::int64_t stops_by_sdo() const;
  std::int64_t times_withheld() const { return times_withheld_; }

 private:
  bool stop_is_commanded(Instant now) const;
  void begin(Instant now);
  void end(Instant now);
  void look_at(Node& node, Instant now);
  bool is_confirmed(std::size_t axis, Instant now) const;
  bool in_reach_of_pdos(const Node& node, Instant now) const;
  bool starves(const Node& node, Instant now) const;

  Drives& d_;
  std::optional<Instant> since_;           // beginning of the stop
  std::optional<Instant> withheld_since_;  // by an unconfirmed stop
  std::optional<Instant> recalled_;        // the newest NMT command to "stopped" nodes
  std::array<bool, 2> obeyed_{};           // each axis, since the stop began
  std::int64_t times_withheld_ = 0;
};

}  // namespace tether::cia402
