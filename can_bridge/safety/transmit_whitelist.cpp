#include "can_bridge/safety/transmit_whitelist.hpp"

#include <algorithm>

namespace tether {

bool TransmitWhitelist::pass(CanFrame& frame, bool may_move) {
  const auto found =
      std::find_if(rules_.frames.begin(), rules_.frames.end(),
                   [&frame](const TransmitRules::Frame& f) { return f.id == frame.id; });
  if (found == rules_.frames.end() || frame.extended || frame.remote || frame.size > 8) {
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
  const auto& ids = rules_.sdo_ids;
  if (std::find(ids.begin(), ids.end(), frame.id) == ids.end()) return false;
  const auto& d = frame.data;
  const bool initiates_download = d[0] >> 5 == 1;  // CiA 301: ccs = 1
  const ObjectRef object{static_cast<std::uint16_t>(d[1] | d[2] << 8), d[3], 0, false};
  if (!initiates_download || std::none_of(rules_.setpoints.begin(), rules_.setpoints.end(),
                                          [&](const auto& s) { return same_object(s, object); })) {
    return false;
  }
  return std::any_of(d.begin() + 4, d.end(), [](std::uint8_t byte) { return byte != 0; });
}

}  // namespace tether
