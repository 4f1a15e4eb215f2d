#pragma once

#include "common/onboard/onboard_settings.hpp"
#include "common/scenario/section.hpp"

namespace tether {

/// [autonomy]. With autonomy.enabled = false, its default, nothing of it is in a scenario.
ScenarioSection autonomy_section();

}  // namespace tether
