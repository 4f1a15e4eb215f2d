#pragma once

#include <string>
#include <vector>

#include "common/scenario/key_table.hpp"
#include "netem/link/link_config.hpp"

namespace tether {

/// The keys of one link; they begin with `prefix`.
std::vector<ScenarioKey> link_keys(const std::string& prefix,
                                   const ScenarioField<LinkConfig>& link);

}  // namespace tether
