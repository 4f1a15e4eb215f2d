#pragma once

#include "common/scenario/section.hpp"

namespace tether {

/// [localiser], LocaliserSettings. With place = "none" nothing of it is in a resolved scenario, and
/// no other key of it may be given.
ScenarioSection localiser_section();

}  // namespace tether
