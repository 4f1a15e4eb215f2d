#include "can_bridge/safety/transmit_whitelist.hpp"

#include <algorithm>
#include <cassert>

namespace tether {
namespace {

/// Identifiers of CiA 301's predefined connection set.
constexpr std::uint32_t kNmt = 0x000, kSync = 0x080, kRpdo1 = 0x200, kSdoRequest = 0x600,
                        kHeartbeat = 0x700;

bool same_object(const ObjectRef& a, const ObjectRef& b) {
  return a.index == b.index && a.sub == b.sub;
}

}  // namespace

TransmitWhitelist::TransmitWhitelist(const DrivetrainConfig& config) {
  if (config.profile == DrivetrainConfig::Profile::agilex_v2) {
    allowed_ = {{0x111, 0xFF}, {0x421, 0}, {0x441, 0}};
  } else {
    allow_cia402(config);
  }
}

void TransmitWhitelist::allow_cia402(const DrivetrainConfig& config) {
  allowed_ = {{kNmt, 0}, {kSync, 0}, {kHeartbeat + config.master_node, 0}};
  for (const AxisConfig& axis : config.axes) {
    setpoints_.push_back(axis.target_velocity);
    sdo_ids_.push_back(kSdoRequest + axis.node);
    allowed_.push_back({kSdoRequest + axis.node, 0});
  }
  for (const PdoConfig& pdo : config.pdos) {
    if (pdo.transmit) continue;
    assert(pdo.number >= 1 && pdo.number <= 4);
    Allowed entry{kRpdo1 + 0x100U * static_cast<std::uint32_t>(pdo.number - 1) + pdo.node, 0};
    unsigned offset = 0;
    for (const ObjectRef& object : pdo.objects) {
      const bool setpoint = std::any_of(setpoints_.begin(), setpoints_.end(),
                                        [&](const auto& s) { return same_object(s, object); });
      const unsigned bytes = ((1U << object.bytes) - 1U) << offset;
      if (setpoint) entry.setpoint_mask = static_cast<std::uint8_t>(entry.setpoint_mask | bytes);
      offset += object.bytes;
    }
    allowed_.push_back(entry);
  }
}

bool TransmitWhitelist::pass(CanFrame& frame, bool may_move) {
  const auto found = std::find_if(allowed_.begin(), allowed_.end(),
                                  [&frame](const Allowed& a) { return a.id == frame.id; });
  if (found == allowed_.end() || frame.extended || frame.remote || frame.size > 8) {
    ++counters_.denied;
    return false;
  }
  if (may_move) return true;
  if (writes_setpoint_by_sdo(frame)) {
    ++counters_.denied;
    return false;
  }
  bool zeroed = false;
  for (std::size_t i = 0; i < frame.size; ++i) {
    if ((found->setpoint_mask >> i & 1U) == 0 || frame.data[i] == 0) continue;
    frame.data[i] = 0;
    zeroed = true;
  }
  if (zeroed) ++counters_.zeroed;
  return true;
}

bool TransmitWhitelist::writes_setpoint_by_sdo(const CanFrame& frame) const {
  if (std::find(sdo_ids_.begin(), sdo_ids_.end(), frame.id) == sdo_ids_.end()) return false;
  const auto& d = frame.data;
  const bool initiates_download = d[0] >> 5 == 1;  // CiA 301: ccs = 1
  const ObjectRef object{static_cast<std::uint16_t>(d[1] | d[2] << 8), d[3], 0, false};
  if (!initiates_download || std::none_of(setpoints_.begin(), setpoints_.end(),
                                          [&](const auto& s) { return same_object(s, object); })) {
    return false;
  }
  return std::any_of(d.begin() + 4, d.end(), [](std::uint8_t byte) { return byte != 0; });
}

}  // namespace tether
