#include "common/actuator/actuator_policy.hpp"

#include <algorithm>
#include <cassert>

namespace tether {

#define TETHER_ACTUATOR_POLICIES(POLICY) \
  POLICY(hold)                           \
  POLICY(zero)                           \
  POLICY(ramp)                           \
  POLICY(decay)                          \
  POLICY(horizon)

#define TETHER_DECLARE(name) ActuatorPolicy name##_policy();
TETHER_ACTUATOR_POLICIES(TETHER_DECLARE)
#undef TETHER_DECLARE

const std::vector<ActuatorPolicy>& actuator_policies() {
#define TETHER_ROW(name) name##_policy(),
  static const std::vector<ActuatorPolicy> policies{TETHER_ACTUATOR_POLICIES(TETHER_ROW)};
#undef TETHER_ROW
  return policies;
}

const ActuatorPolicy& kind_of(const ActuatorSettings& settings) {
  const auto& policies = actuator_policies();
  const auto found =
      std::find_if(policies.begin(), policies.end(),
                   [&](const ActuatorPolicy& policy) { return policy.name == settings.policy; });
  assert(found != policies.end());
  return *found;
}

}  // namespace tether
