#include "common/vehicle/actuator_policy.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace tether {
namespace {

Twist decayed(const Twist& from, double since_s, double time_constant_s) {
  constexpr double kTiny_mps = 1e-3, kTiny_radps = 1e-3;
  const double share = std::exp(-since_s / time_constant_s);
  const Twist twist{from.v_mps * share, from.omega_radps * share};
  const bool tiny = std::abs(twist.v_mps) < kTiny_mps && std::abs(twist.omega_radps) < kTiny_radps;
  return tiny ? Twist{} : twist;
}

ActuatorPolicy decay_policy() {
  return {.name = "decay",
          .keys = {"decay_s"},
          .after_timeout = [](const Twist& command, Duration since,
                              const ActuatorSettings& settings, const StopLimits& limits) {
            return decayed(within_wheel_speed(command, limits), to_seconds(since),
                           settings.decay_s);
          }};
}

ActuatorPolicy hold_policy() { return {.name = "hold"}; }

/// Comes to a stop by ramp_to_stop().
ActuatorPolicy ramping(const std::string& name) {
  return {.name = name,
          .keys = {"deceleration_mps2", "yaw_deceleration_radps2"},
          .after_timeout = [](const Twist& command, Duration since, const ActuatorSettings&,
                              const StopLimits& limits) {
            return ramp_to_stop(command, since, limits);
          }};
}

ActuatorPolicy ramp_policy() { return ramping("ramp"); }

/// Plans end with the ramp (PlanBuffer); twists are treated as by `ramp`.
ActuatorPolicy horizon_policy() {
  ActuatorPolicy policy = ramping("horizon");
  policy.takes_plans = true;
  return policy;
}

ActuatorPolicy zero_policy() {
  return {.name = "zero",
          .after_timeout = [](const Twist&, Duration, const ActuatorSettings&, const StopLimits&) {
            return Twist{};
          }};
}

}  // namespace

const std::vector<ActuatorPolicy>& actuator_policies() {
  static const std::vector<ActuatorPolicy> policies{hold_policy(), zero_policy(), ramp_policy(),
                                                    decay_policy(), horizon_policy()};
  return policies;
}

StopLimits stop_limits(const ActuatorSettings& config, const VehicleConfig& vehicle) {
  return {config.deceleration_mps2, config.yaw_deceleration_radps2,
          vehicle.max_wheel_acceleration_mps2, vehicle.max_wheel_speed_mps, vehicle.track_m};
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
