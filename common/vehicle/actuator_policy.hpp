#pragma once

#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/stop_ramp.hpp"

namespace tether {

/// One of the values of actuator.policy. A new one is a function <name>_policy() in
/// actuator_policy.cpp that returns its row, and its place in actuator_policies().
struct ActuatorPolicy {
  std::string name;
  bool takes_plans = false;  ///< and follows them by time; others count and ignore them
  /// Keys of [actuator], without "actuator.", that only some policies use, this one among them.
  std::vector<std::string> keys = {};
  /// The twist in force `since` (≥ 0) after the last command (finite) timed out. Pure. Null: that
  /// command, for it stays in force.
  Twist (*after_timeout)(const Twist& command, Duration since, const ActuatorSettings&,
                         const StopLimits&) = nullptr;
  std::vector<ScenarioKey> own_keys = {};  ///< keys of ActuatorSettings::own; also among `keys`
};

/// All policies, in the order in which messages name them.
const std::vector<ActuatorPolicy>& actuator_policies();
const ActuatorPolicy& kind_of(const ActuatorSettings& settings);
/// Limits of a stop that a policy makes.
StopLimits stop_limits(const ActuatorSettings& settings, const VehicleConfig& vehicle);

}  // namespace tether
