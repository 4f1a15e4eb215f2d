#include "can_bridge/bus/can_frame.hpp"

#include <algorithm>
#include <cassert>

namespace tether {

CanFrame CanFrame::make(std::uint32_t id, std::span<const std::uint8_t> bytes) {
  assert(bytes.size() <= 8);
  CanFrame frame;
  frame.id = id;
  frame.size = static_cast<std::uint8_t>(bytes.size());
  std::copy(bytes.begin(), bytes.end(), frame.data.begin());
  return frame;
}

}  // namespace tether
