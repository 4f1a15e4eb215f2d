#pragma once

#include "can_bridge/bus/in_process_can.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/can/arm_operator.hpp"

namespace tether {

/// The drivetrain of a virtual run: the shipping bridge and the emulated drives on a CAN bus in
/// virtual time, and the operator who arms it.
class CanLoop {
 public:
  CanLoop(const Scenario& scenario, EventLoop& loop, Bus& bus)
      : config_(load_drivetrain(scenario.get<CanSettings>().drivetrain_file)),
        can_(loop, scenario.get<CanSettings>().bit_rate_bps),
        drives_(scenario, config_, loop, bus, can_.add_port()),
        bridge_port_(can_.add_port()),
        bridge_(scenario, config_, loop, bus, bridge_port_),
        operator_(scenario, loop, bus) {}

  InProcessCan& can() { return can_; }
  /// For tests: the bridge's plug.
  InProcessCan::Port& bridge_port() { return bridge_port_; }

  void finish() {
    bridge_.finish();
    drives_.finish();
  }

 private:
  DrivetrainConfig config_;
  InProcessCan can_;
  CanDriveNode drives_;
  InProcessCan::Port& bridge_port_;
  CanBridgeNode bridge_;
  ArmOperator operator_;
};

}  // namespace tether
