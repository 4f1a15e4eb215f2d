#pragma once

#include <string>

#include "common/scenario/own_settings.hpp"
#include "common/scenario/section.hpp"

namespace tether {

/// [actuator]: what the vehicle does with commands and plans, and without. Which keys a policy
/// uses is said in its row (actuator_policy.hpp).
struct ActuatorSettings {
  std::string policy = "hold";  ///< the name of one of actuator_policies()
  double timeout_s = 0.5;       ///< all but hold: without a new twist for this long, stop
  double decay_s = 0.5;         ///< policy = decay: time constant of the stop
  // policy = ramp, horizon: of the stop; the wheels' acceleration limit holds, too.
  double deceleration_mps2 = 1.5;
  double yaw_deceleration_radps2 = 3.0;
  OwnSettings own;  ///< settings of policies with keys that no other policy has
};

ScenarioSection actuator_section();

}  // namespace tether
