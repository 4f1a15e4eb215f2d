#include "tools/gym/action.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"

namespace tether {
namespace {

constexpr double kLongestLookAhead_s = 60.0;

struct KindRow {
  ActionKind kind;
  const char* name;
  bool decides;  ///< in the place of the law
  bool (*suits)(const LawKind&);
};
constexpr KindRow kKinds[] = {
    {ActionKind::twist, "twist", true, [](const LawKind& l) { return !l.sends_plans; }},
    {ActionKind::plan, "plan", true, [](const LawKind& l) { return l.sends_plans; }},
    {ActionKind::tau, "tau", false, [](const LawKind& l) { return l.looks_ahead; }},
    {ActionKind::send, "send", false, [](const LawKind&) { return true; }},
};

const KindRow& row_of(ActionKind kind) {
  return *std::find_if(std::begin(kKinds), std::end(kKinds),
                       [&](const KindRow& row) { return row.kind == kind; });
}

bool suits(const KindRow& row, const LawKind& law) {
  return row.suits(law) && !(row.decides && law.drives_on_request);
}

}  // namespace

ActionKind action_kind(const std::string& name) {
  std::string names;
  for (const KindRow& row : kKinds) {
    if (row.name == name) return row.kind;
    names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", row.name);
  }
  throw UsageError(fmt::format("action: there is no \"{}\"; allowed: {}", name, names));
}

std::vector<NumberSpace> action_space(const Scenario& scenario, ActionKind kind) {
  const auto& controller = scenario.get<ControllerSettings>();
  const NumberSpace send{"send", 0.0, 1.0};
  if (kind == ActionKind::send) return {send};
  if (kind == ActionKind::tau) return {{"tau_s", 0.0, kLongestLookAhead_s}, send};
  std::vector<NumberSpace> space;
  const std::size_t twists = kind == ActionKind::plan ? controller.plan_steps() : 1;
  for (std::size_t i = 0; i < twists; ++i) {
    space.push_back({"v_mps", -controller.v.limit, controller.v.limit});
    space.push_back({"omega_radps", -controller.omega.limit, controller.omega.limit});
  }
  return space;
}

void check_actions(const Scenario& scenario, ActionKind kind) {
  const auto& controller = scenario.get<ControllerSettings>();
  if (!scenario.get<FleetSettings>().is_one()) {
    throw UsageError("fleet.count: an environment has one vehicle; allowed: 1");
  }
  const KindRow& row = row_of(kind);
  if (!suits(row, kind_of(controller))) {
    std::string laws;
    for (const LawKind& law : law_kinds()) {
      if (suits(row, law)) laws += (laws.empty() ? "" : ", ") + law.name;
    }
    throw UsageError(
        fmt::format("controller.law: there are no actions \"{}\" with \"{}\"; allowed: {}",
                    row.name, controller.law, laws));
  }
  if (!row.decides) return;
  if (controller.estimator != ControllerSettings::Estimator::none) {
    throw UsageError(
        fmt::format("controller.estimator: actions \"{}\" take the place of the law and its "
                    "filter; allowed: none",
                    row.name));
  }
  if (controller.preload) {
    throw UsageError(
        "controller.preload: no action makes the plan before departure; allowed: false");
  }
}

void check_action(std::span<const double> action, std::span<const NumberSpace> space) {
  for (std::size_t i = 0; i < action.size(); ++i) {
    const NumberSpace& allowed = space[i];
    if (action[i] >= allowed.low && action[i] <= allowed.high) continue;  // never of NaN
    throw UsageError(fmt::format("action[{}] ({}) is {}; allowed: a number in [{}, {}]", i,
                                 allowed.name, action[i], allowed.low, allowed.high));
  }
}

}  // namespace tether
