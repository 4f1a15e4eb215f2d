#include "common/actuator/actuator_policy.hpp"

namespace tether {
namespace {

/// Comes to a stop by ramp_to_stop().
ActuatorPolicy ramping(const std::string& name) {
  return {.name = name,
          .keys = {"deceleration_mps2", "yaw_deceleration_radps2"},
          .after_timeout = [](const Twist& command, Duration since, const ActuatorSettings&,
                              const StopLimits& limits) {
            return ramp_to_stop(command, since, limits);
          }};
}

}  // namespace

ActuatorPolicy ramp_policy() { return ramping("ramp"); }

/// Plans end with the ramp (PlanBuffer); twists are treated as by `ramp`.
ActuatorPolicy horizon_policy() {
  ActuatorPolicy policy = ramping("horizon");
  policy.takes_plans = true;
  return policy;
}

}  // namespace tether
