#pragma once

#include <memory>

#include "can_bridge/drivetrain_config.hpp"
#include "can_bridge/socket_can_port.hpp"
#include "common/errors.hpp"
#include "common/node.hpp"
#include "common/node_main.hpp"

namespace tether {

/// A node on the scenario's SocketCAN interface and drivetrain, with all that it needs.
template <class CanNodeType>
class OnSocketCan final : public Node {
 public:
  explicit OnSocketCan(const NodeContext& c)
      : config_(load_drivetrain(required(c.scenario))),
        port_(c.scenario.can.interface, c.loop),
        node_(c.scenario, config_, c.loop, c.bus, port_) {}

  bool wind_down() override { return node_.wind_down(); }
  void finish() override { node_.finish(); }

 private:
  static const std::string& required(const Scenario& scenario) {
    if (scenario.vehicle.drivetrain == Scenario::Vehicle::Drivetrain::can) {
      return scenario.can.drivetrain_file;
    }
    throw UsageError("the scenario has no CAN drivetrain: set vehicle.drivetrain = \"can\"");
  }

  DrivetrainConfig config_;
  SocketCanPort port_;
  CanNodeType node_;
};

}  // namespace tether
