#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/axes.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/node_startup.hpp"
#include "can_bridge/cia402/read_back.hpp"
#include "can_bridge/cia402/stage.hpp"
#include "can_bridge/cia402/standstill.hpp"
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
  /// `stop_first`: it may have been switched on just now.
  void begin_inquiry(bool stop_first = false);
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

/// All that the stages work on: the drives as they are known, and the stage itself.
struct Drives {
  /// Between NMT commands to drives that are in NMT "stopped", where SDO is dead.
  static constexpr Duration kRecall = std::chrono::milliseconds(100);

  Drives(const Cia402Config& c, double wheel_radius_m, double track_m)
      : config(c),
        axes(c, wheel_radius_m, track_m),
        nodes(c),
        heartbeat(c.master_node, std::chrono::milliseconds(c.heartbeat_ms)) {}

  Duration step_timeout() const { return std::chrono::milliseconds(config.step_timeout_ms); }
  Duration heartbeat_timeout() const {
    return std::chrono::milliseconds(config.drive_heartbeat_timeout_ms);
  }
  Duration feedback_timeout() const {
    return std::chrono::milliseconds(config.feedback_timeout_ms);
  }
  /// Whether what goes wrong with a drive now counts as a fault.
  bool supervised() const {
    return stage.stage() >= Stage::settling && stage.stage() != Stage::refused && commanding;
  }
  void refuse(std::string reason) { stage.enter(Stage::refused, std::move(reason)); }

  Cia402Config config;
  Axes axes;
  Nodes nodes;
  HeartbeatProducer heartbeat;
  StageClock stage;
  bool commanding = false;  ///< setpoints and SYNC are sent
};

}  // namespace tether::cia402
