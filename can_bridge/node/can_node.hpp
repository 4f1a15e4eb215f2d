#pragma once

#include <fmt/format.h>

#include <memory>
#include <string>

#include "can_bridge/bus/socket_can_port.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "common/node/node.hpp"
#include "common/program/node_main.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// A node on the scenario's SocketCAN interface and drivetrain, with all that it needs. Throws
/// UsageError without a CAN drivetrain, and for slow motion unless the drives are emulated ones:
/// real drives and wheels do not slow down with the bridge's deadlines.
template <class CanNodeType>
class OnSocketCan final : public Node {
 public:
  explicit OnSocketCan(const NodeContext& c)
      : config_(load_drivetrain(required(c))),
        port_(c.scenario.get<CanSettings>().interface, c.loop),
        node_(c.scenario, config_, c.loop, c.bus, port_) {}

  CanNodeType& node() { return node_; }
  const DrivetrainConfig& config() const { return config_; }

  bool wind_down() override { return node_.wind_down(); }
  void finish() override { node_.finish(); }

 private:
  static const std::string& required(const NodeContext& c) {
    if (c.scenario.get<VehicleSettings>().drivetrain != VehicleSettings::Drivetrain::can) {
      throw UsageError("the scenario has no CAN drivetrain: set vehicle.drivetrain = \"can\"");
    }
    if (!c.scenario.get<CanSettings>().emulate_drives && c.loop.rate() < 1.0) {
      throw UsageError(
          fmt::format("--speed {}: slow motion stretches the bridge's time-outs: only with "
                      "can.emulate_drives = true",
                      c.loop.rate()));
    }
    return c.scenario.get<CanSettings>().drivetrain_file;
  }

  DrivetrainConfig config_;
  SocketCanPort port_;
  CanNodeType node_;
};

}  // namespace tether
