#include "common/vehicle/actuator_policy.hpp"

namespace tether {

ActuatorPolicy hold_policy() { return {.name = "hold"}; }

}  // namespace tether
