#pragma once

#include <string>

#include "common/scenario/scenario.hpp"

namespace tether {

/// Throws UsageError that names `file` where keys that are each allowed contradict each other.
void check_combinations(const Scenario& scenario, const std::string& file);

}  // namespace tether
