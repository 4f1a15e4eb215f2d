#include "common/vehicle/actuator_settings.hpp"

#include "common/scenario/key_table.hpp"

namespace tether {
namespace {

using Actuator = ActuatorSettings;
using Policy = Actuator::Policy;

/// Of the ways to stop, only the chosen one's keys say something.
bool left_out(const Scenario& scenario, const ScenarioKey& key) {
  const Policy policy = scenario.get<Actuator>().policy;
  if (key.name == "actuator.decay_s") return policy != Policy::decay;
  const bool is_ramp =
      key.name == "actuator.deceleration_mps2" || key.name == "actuator.yaw_deceleration_radps2";
  return is_ramp && policy != Policy::ramp && policy != Policy::horizon;
}

}  // namespace

ScenarioSection actuator_section() {
  KeyTable<Actuator> t("actuator.");
  t.choice<Policy>("policy", &Actuator::policy,
                   {{"hold", Policy::hold},
                    {"zero", Policy::zero},
                    {"ramp", Policy::ramp},
                    {"decay", Policy::decay},
                    {"horizon", Policy::horizon}},
                   "hold the last command, stop in some way after a timeout, or follow plans");
  t.number("timeout_s", &Actuator::timeout_s, kPositive,
           "policy = zero, ramp, decay, horizon: stop when no new twist came for this long");
  t.number("decay_s", &Actuator::decay_s, kPositive, "policy = decay: time constant of the stop");
  t.number("deceleration_mps2", &Actuator::deceleration_mps2, kPositive,
           "policy = ramp, horizon: of the stop after the timeout or the horizon");
  t.number("yaw_deceleration_radps2", &Actuator::yaw_deceleration_radps2, kPositive,
           "policy = ramp, horizon: of the stop after the timeout or the horizon");
  return {.defaults = Actuator{}, .keys = t.take(), .left_out = left_out};
}

}  // namespace tether
