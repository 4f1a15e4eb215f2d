// AgilexV2Config: what a bridge may send to this chassis.
#include "can_bridge/agilex/config.hpp"
#include "can_bridge/agilex/v2.hpp"

namespace tether {

TransmitRules AgilexV2Config::transmit_rules() const {
  return {
      .frames = {{agilex::kMotionCommand, 0xFF}, {agilex::kModeCommand}, {agilex::kClearCommand}},
      .setpoints = {},
      .sdo_ids = {}};
}

}  // namespace tether
