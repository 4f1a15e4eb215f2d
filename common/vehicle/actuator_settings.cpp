#include "common/vehicle/actuator_settings.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>

#include "common/scenario/key_table.hpp"
#include "common/vehicle/actuator_policy.hpp"

namespace tether {
namespace {

using Settings = ActuatorSettings;

constexpr std::string_view kPrefix = "actuator.";

bool uses(const ActuatorPolicy& policy, std::string_view part) {
  return std::find(policy.keys.begin(), policy.keys.end(), part) != policy.keys.end();
}

/// "policy = NAME, NAME": those of which `is` is true.
template <class Predicate>
std::string policies_that(Predicate is) {
  std::vector<std::string> names;
  for (const ActuatorPolicy& policy : actuator_policies()) {
    if (is(policy)) names.push_back(policy.name);
  }
  return fmt::format("policy = {}", fmt::join(names, ", "));
}

std::string policies_with(std::string_view key) {
  return policies_that([key](const ActuatorPolicy& policy) { return uses(policy, key); });
}

/// True for keys that belong to a stopping policy other than the chosen one.
bool left_out(const Scenario& scenario, const ScenarioKey& key) {
  if (!key.name.starts_with(kPrefix)) return false;
  const std::string_view part = std::string_view(key.name).substr(kPrefix.size());
  const auto& policies = actuator_policies();
  return !uses(kind_of(scenario.get<Settings>()), part) &&
         std::any_of(policies.begin(), policies.end(),
                     [&](const ActuatorPolicy& other) { return uses(other, part); });
}

}  // namespace

ScenarioSection actuator_section() {
  KeyTable<Settings> t{std::string(kPrefix)};
  std::vector<std::string> names;
  for (const ActuatorPolicy& policy : actuator_policies()) names.push_back(policy.name);
  t.one_of("policy", &Settings::policy, names,
           "reaction to a silent network: hold the last command, stop in some way after a timeout, "
           "or follow plans");
  t.number("timeout_s", &Settings::timeout_s, kPositive,
           policies_that([](const ActuatorPolicy& p) { return p.after_timeout != nullptr; }) +
               ": time without a new twist after which the vehicle stops");
  t.number("decay_s", &Settings::decay_s, kPositive,
           policies_with("decay_s") + ": time constant of the stop");
  t.number("deceleration_mps2", &Settings::deceleration_mps2, kPositive,
           policies_with("deceleration_mps2") +
               ": deceleration of the stop after the timeout or the horizon");
  t.number("yaw_deceleration_radps2", &Settings::yaw_deceleration_radps2, kPositive,
           policies_with("yaw_deceleration_radps2") +
               ": deceleration of the stop after the timeout or the horizon");
  for (const ActuatorPolicy& policy : actuator_policies()) t.append(policy.own_keys);
  return {.defaults = Settings{}, .keys = t.take(), .left_out = left_out};
}

}  // namespace tether
