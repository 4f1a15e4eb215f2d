#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/drives/standstill.hpp"
#include "can_bridge/cia402/node_startup.hpp"
#include "can_bridge/cia402/read_back.hpp"

namespace tether::cia402 {

/// One CANopen node of the drivetrain: what was heard of it, its start-up and its inquiries.
struct Node {
  Node(const Cia402Config& config, std::uint8_t number);

  /// A frame with the identifier 0x700 + node: the state that it tells, nullopt if it is no
  /// heartbeat.
  std::optional<canopen::NmtState> on_heartbeat(const CanFrame& frame, Instant now);
  bool operational() const { return state == canopen::NmtState::operational; }
  /// Another's NMT command to this node: it is not known to be operational any more.
  void on_foreign_nmt(const CanFrame& frame);
  /// Asks from the beginning whether its wheels stand, before it is reset.
  void begin_inquiry();
  /// Nothing is heard of it, and it has left a request unanswered: it may be in NMT "stopped",
  /// where SDO is dead, and without a heartbeat it does not tell so.
  bool may_be_stopped() const;
  /// Nothing but its boot-up message was heard of it.
  bool booted() const { return state == canopen::NmtState::boot_up; }

  std::uint8_t id;
  std::string name;  ///< for reasons
  NodeStartup startup;
  ReadBack read_back;                      ///< before it is enabled
  StandstillInquiry inquiry;               ///< before it is reset
  StandstillInquiry stopper;               ///< impatient: while it is stopped by SDO
  std::optional<canopen::NmtState> state;  ///< state in the newest heartbeat
  Instant heartbeat_stamp{};
  // Before it is reset:
  bool heard = false;    ///< in any NMT state, and not booted since
  bool running = false;  ///< operational
  bool lost = false;     ///< the bridge commanded it, and does not know that it has stopped
  std::optional<Instant> recalled;         ///< first NMT "pre-operational" since begin_inquiry()
  std::optional<Instant> newest_recalled;  ///< the newest one
  bool pdos_doubtful = false;              ///< another sender has written its PDO parameters
  // While it is to stop (StopAssurance):
  bool by_sdo = false;       ///< it gets its controlword by SDO
  bool unconfirmed = false;  ///< it has not told in time that it stops
};

/// The drivetrain's nodes, left first, each once.
class Nodes {
 public:
  explicit Nodes(const Cia402Config& config);

  auto begin() { return nodes_.begin(); }
  auto begin() const { return nodes_.begin(); }
  auto end() { return nodes_.end(); }
  auto end() const { return nodes_.end(); }
  /// `id` must be one of them.
  Node& of(std::uint8_t id) { return id == nodes_.front().id ? nodes_.front() : nodes_.back(); }

  bool any_heard() const;
  bool any_running() const;
  /// Whether one got NMT "reset node" since begin_startup().
  bool any_reset() const;
  bool all_operational() const;
  /// Whether node `id` did not show its mode of operation in its start-up.
  bool show_mode_late(std::uint8_t id) const;

  /// A new start, before anything is heard or sent. `commanding`: operational nodes get setpoints
  /// already.
  void begin_inquiry(bool commanding);
  /// Forgets what was heard and starts all nodes up.
  void begin_startup();
  /// Forgets the nodes' states until their next heartbeats.
  void forget_states();

  /// Next event that the start-up of all nodes waits for, and why it failed ("" where it has not).
  std::string progress() const;
  std::string refusals() const;
  bool started_up() const;
  /// The optional objects that the drives do not have, or refused.
  std::vector<std::string> notes() const;

 private:
  std::vector<Node> nodes_;
};

}  // namespace tether::cia402
