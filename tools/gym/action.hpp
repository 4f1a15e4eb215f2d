#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// Kind of an episode's action.
enum class ActionKind : std::uint8_t {
  twist,  ///< [v_mps, omega_radps]: in the place of a law that sends twists
  plan,   ///< controller.horizon_s / controller.plan_step_ms twists: in the place of one that plans
  tau,    ///< [tau_s, send]: the scenario's law decides with this look-ahead
  send,   ///< [send]: the scenario's law decides; from 0.5 on its decision goes out
};

/// Throws UsageError with the allowed names.
ActionKind action_kind(const std::string& name);

/// One number of an action or an observation, and what it may be.
struct NumberSpace {
  std::string name;
  double low;
  double high;
  bool operator==(const NumberSpace&) const = default;
};

/// The numbers of an action, a plan's twists one after another. Twists are within
/// controller.v.limit and controller.omega.limit, look-aheads in [0, 60] s.
std::vector<NumberSpace> action_space(const Scenario& scenario, ActionKind kind);

/// Throws UsageError for a scenario with which there are no such actions: of several vehicles, with
/// a law that does something else, or with keys that then do nothing.
void check_actions(const Scenario& scenario, ActionKind kind);

/// Throws UsageError that names the number that is not finite or not within its space.
void check_action(std::span<const double> action, std::span<const NumberSpace> space);

}  // namespace tether
