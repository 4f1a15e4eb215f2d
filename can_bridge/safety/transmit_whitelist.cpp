#include "can_bridge/safety/transmit_whitelist.hpp"

#include <algorithm>

namespace tether {
namespace {

/// Whether an SDO request is about one of the objects.
bool names(const CanFrame& frame, const std::vector<ObjectRef>& objects) {
  const auto& d = frame.data;
  const ObjectRef object{static_cast<std::uint16_t>(d[1] | d[2] << 8), d[3], 0, false};
  return std::any_of(objects.begin(), objects.end(),
                     [&](const auto& o) { return same_object(o, object); });
}

/// The last four bytes of an SDO request: an expedited value, or the size of a longer one.
std::uint32_t value(const CanFrame& frame) {
  const auto& d = frame.data;
  return static_cast<std::uint32_t>(d[4] | d[5] << 8 | d[6] << 16) |
         static_cast<std::uint32_t>(d[7]) << 24;
}

}  // namespace

bool TransmitWhitelist::pass(CanFrame& frame, bool may_move) {
  const auto found = std::find_if(rules_.frames.begin(), rules_.frames.end(),
                                  [&frame](const TransmitRules::Frame& f) {
                                    return f.id == frame.id && f.extended == frame.extended;
                                  });
  if (found == rules_.frames.end() || frame.remote || frame.size > 8) {
    ++counters_.denied;
    return false;
  }
  if (writes_setpoint_by_sdo(frame) || switches_on_by_sdo(frame)) {
    ++counters_.denied;
    return false;
  }
  if (may_move) return true;
  bool zeroed = false;
  for (std::size_t i = 0; i < frame.size; ++i) {
    if ((found->setpoint_mask >> i & 1U) == 0 || frame.data[i] == 0) continue;
    frame.data[i] = 0;
    zeroed = true;
  }
  if (zeroed) ++counters_.zeroed;
  return true;
}

bool TransmitWhitelist::initiates_sdo_download(const CanFrame& frame) const {
  const auto& ids = rules_.sdo_ids;
  // CiA 301, 7.2.4.3: client command specifier 1, or 6 for a block.
  const int command = frame.data[0] >> 5;
  return !frame.extended && std::find(ids.begin(), ids.end(), frame.id) != ids.end() &&
         (command == 1 || command == 6);
}

bool TransmitWhitelist::writes_setpoint_by_sdo(const CanFrame& frame) const {
  return initiates_sdo_download(frame) && names(frame, rules_.setpoints) && value(frame) != 0;
}

bool TransmitWhitelist::switches_on_by_sdo(const CanFrame& frame) const {
  if (!initiates_sdo_download(frame) || !names(frame, rules_.controlwords)) return false;
  const bool expedited = frame.data[0] >> 5 == 1 && (frame.data[0] & 0x02) != 0;
  return !expedited || std::find(rules_.stop_words.begin(), rules_.stop_words.end(),
                                 value(frame)) == rules_.stop_words.end();
}

}  // namespace tether
