#pragma once

#include "common/scenario/section.hpp"
#include "common/world/onboard_settings.hpp"

namespace tether {

/// [autonomy]. With autonomy.enabled = false, its default, nothing of it is in a scenario.
ScenarioSection autonomy_section();

}  // namespace tether
