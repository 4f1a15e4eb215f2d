#include "controller/laws/law.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

#include "common/path/controlled_point.hpp"
#include "common/path/kinds.hpp"
#include "controller/laws/axle_path.hpp"
#include "controller/laws/filtered_law.hpp"

namespace tether {

#define TETHER_CONTROL_LAWS(LAW) \
  LAW(pid)                       \
  LAW(pid_adaptive)              \
  LAW(tracking)                  \
  LAW(tracking_compensated)      \
  LAW(predictive)                \
  LAW(predictive_consistent)     \
  LAW(mpc)                       \
  LAW(detour)

#define TETHER_DECLARE(name) LawKind name##_law();
TETHER_CONTROL_LAWS(TETHER_DECLARE)
#undef TETHER_DECLARE

const std::vector<LawKind>& law_kinds() {
#define TETHER_ROW(name) name##_law(),
  static const std::vector<LawKind> kinds{TETHER_CONTROL_LAWS(TETHER_ROW)};
#undef TETHER_ROW
  return kinds;
}

const LawKind& kind_of(const ControllerSettings& settings) {
  const auto& kinds = law_kinds();
  const auto found = std::find_if(kinds.begin(), kinds.end(),
                                  [&](const LawKind& kind) { return kind.name == settings.law; });
  assert(found != kinds.end());
  return *found;
}

LawContext law_context(const LawSettings& settings, bool steers_any_point) {
  LawContext context{
      settings, make_path(settings.get<PathSettings>()),
      controlled_point_ahead_m(settings.get<PathSettings>(), settings.get<VehicleSettings>())};
  if (context.ahead_m != 0.0 && !steers_any_point) {
    context.path = std::make_shared<AxlePath>(context.path, context.ahead_m);
    context.ahead_m = 0.0;
  }
  return context;
}

std::unique_ptr<Law> make_law(const LawSettings& settings) {
  const auto& controller = settings.get<ControllerSettings>();
  const LawKind& kind = kind_of(controller);
  const LawContext context = law_context(settings, kind.steers_any_point);
  std::unique_ptr<Law> law = kind.make(context);
  if (controller.estimator == ControllerSettings::Estimator::none || kind.sends_plans) return law;
  return std::make_unique<FilteredLaw>(std::move(law), context);
}

}  // namespace tether
