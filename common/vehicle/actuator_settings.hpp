#pragma once

#include "common/scenario/section.hpp"

namespace tether {

/// [actuator]: what the vehicle does with commands and plans, and without.
struct ActuatorSettings {
  enum class Policy { hold, zero, ramp, decay, horizon };
  Policy policy = Policy::hold;
  double timeout_s = 0.5;  ///< all but hold: without a new twist for this long, stop
  double decay_s = 0.5;    ///< policy = decay: time constant of the stop
  // policy = ramp, horizon: of the stop; the wheels' acceleration limit holds, too.
  double deceleration_mps2 = 1.5;
  double yaw_deceleration_radps2 = 3.0;
};

ScenarioSection actuator_section();

}  // namespace tether
