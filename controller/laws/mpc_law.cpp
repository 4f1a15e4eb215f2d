#include "common/scenario/key_table.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/predictive_law.hpp"

namespace tether {
namespace {

std::vector<ScenarioKey> mpc_keys() {
  using Mpc = MpcSettings;
  KeyTable<Mpc> t(
      "controller.mpc.",
      {[](const Scenario& s) -> const Mpc& { return s.get<ControllerSettings>().own.get<Mpc>(); },
       [](Scenario& s) -> Mpc& { return s.get<ControllerSettings>().own.get<Mpc>(); }});
  t.number("steps", &Mpc::steps, {1.0, 200.0, false}, "number of optimised steps per plan");
  t.number("heading_m2", &Mpc::heading_m2, kNotNegative,
           "weight of a heading error's square against a distance's");
  t.number("rim_s2", &Mpc::rim_s2, {1e-6, 1e3, false},
           "weight of the square of a rim's change in a step, beyond the path's own");
  t.number("terminal", &Mpc::terminal, {1.0, 1e3, false}, "weight of the last step");
  t.number("within_m", &Mpc::within_m, kNotNegative,
           "farther off the path, plans are the tracking law's");
  t.number("iterations", &Mpc::iterations, {1.0, 10.0, false}, "number of linearisations per plan");
  return t.take();
}

}  // namespace

LawKind predictive_consistent_law();

/// The consistent predictive law, with the first steps of its plans optimised.
LawKind mpc_law() {
  LawKind kind = predictive_consistent_law();
  kind.name = "mpc";
  kind.keys.emplace_back("mpc.");
  kind.own_keys = mpc_keys();
  kind.make = [](const LawContext& context) -> std::unique_ptr<Law> {
    const auto& settings = context.settings.get<ControllerSettings>().own.get<MpcSettings>();
    return std::make_unique<PredictiveLaw>(context, PredictiveLaw::Form::consistent,
                                           MpcPlanner(settings, context.path));
  };
  return kind;
}

}  // namespace tether
