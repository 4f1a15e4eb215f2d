#include "common/actuator/actuator_policy.hpp"

namespace tether {

ActuatorPolicy zero_policy() {
  return {.name = "zero",
          .after_timeout = [](const Twist&, Duration, const ActuatorSettings&, const StopLimits&) {
            return Twist{};
          }};
}

}  // namespace tether
