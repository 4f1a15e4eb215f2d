#include "common/actuator/actuator_policy.hpp"

namespace tether {

ActuatorPolicy hold_policy() { return {.name = "hold"}; }

}  // namespace tether
