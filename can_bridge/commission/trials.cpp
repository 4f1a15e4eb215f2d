#include "can_bridge/commission/trials.hpp"

namespace tether {

const char* trial_name(Trial trial) {
  switch (trial) {
    case Trial::feedback:
      return "feedback";
    case Trial::quick_stop:
      return "quick stop";
    case Trial::silence:
      return "nothing sent";
    case Trial::heartbeat:
      return "heartbeat withheld";
    case Trial::setpoints:
      return "setpoints withheld";
    case Trial::sync:
      return "SYNC withheld";
  }
  return "?";
}

}  // namespace tether
