#pragma once

#include <chrono>

#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/drives/axes.hpp"
#include "can_bridge/cia402/drives/heartbeat.hpp"
#include "can_bridge/cia402/drives/nodes.hpp"
#include "can_bridge/cia402/drives/stage.hpp"

namespace tether::cia402 {

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
