// Cia402Config: what a bridge may send to these drives.
#include <algorithm>
#include <cassert>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/cia402/config.hpp"

namespace tether {

TransmitRules Cia402Config::transmit_rules() const {
  TransmitRules rules;
  rules.frames = {{canopen::kNmt}, {canopen::kSync}, {canopen::kHeartbeat + master_node}};
  for (const AxisConfig& axis : axes) {
    rules.setpoints.push_back(axis.target_velocity);
    rules.controlwords.push_back(axis.controlword);
    rules.sdo_ids.push_back(canopen::kSdoRequest + axis.node);
    rules.frames.push_back({canopen::kSdoRequest + axis.node});
  }
  rules.stop_words = {canopen::kControlQuickStop, canopen::kControlDisableVoltage};
  for (const PdoConfig& pdo : pdos) {
    if (pdo.transmit) continue;
    assert(pdo.number >= 1 && pdo.number <= 4);
    TransmitRules::Frame frame{canopen::pdo_id(false, pdo.number, pdo.node)};
    unsigned offset = 0;
    for (const ObjectRef& object : pdo.objects) {
      const bool setpoint = std::any_of(rules.setpoints.begin(), rules.setpoints.end(),
                                        [&](const ObjectRef& s) { return same_object(s, object); });
      const unsigned bytes = ((1U << object.bytes) - 1U) << offset;
      if (setpoint) frame.setpoint_mask = static_cast<std::uint8_t>(frame.setpoint_mask | bytes);
      offset += object.bytes;
    }
    rules.frames.push_back(frame);
  }
  return rules;
}

}  // namespace tether
