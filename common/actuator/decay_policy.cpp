#include <cmath>

#include "common/actuator/actuator_policy.hpp"

namespace tether {
namespace {

Twist decayed(const Twist& from, double since_s, double time_constant_s) {
  constexpr double kTiny_mps = 1e-3, kTiny_radps = 1e-3;
  const double share = std::exp(-since_s / time_constant_s);
  const Twist twist{from.v_mps * share, from.omega_radps * share};
  const bool tiny = std::abs(twist.v_mps) < kTiny_mps && std::abs(twist.omega_radps) < kTiny_radps;
  return tiny ? Twist{} : twist;
}

}  // namespace

ActuatorPolicy decay_policy() {
  return {.name = "decay",
          .keys = {"decay_s"},
          .after_timeout = [](const Twist& command, Duration since,
                              const ActuatorSettings& settings, const StopLimits& limits) {
            return decayed(within_wheel_speed(command, limits), to_seconds(since),
                           settings.decay_s);
          }};
}

}  // namespace tether
