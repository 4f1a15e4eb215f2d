#include "can_bridge/bus/can_port.hpp"

namespace tether {

const char* to_string(CanState state) {
  switch (state) {
    case CanState::up:
      return "up";
    case CanState::error_passive:
      return "error-passive";
    case CanState::stalled:
      return "stalled";
    case CanState::bus_off:
      return "bus-off";
    case CanState::down:
      return "down";
    case CanState::absent:
      return "absent";
  }
  return "unknown";
}

}  // namespace tether
