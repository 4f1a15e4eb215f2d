#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace tether {

/// Named counters in a fixed order, for reports: {"command.reordered", 3}.
using CounterList = std::vector<std::pair<std::string, std::int64_t>>;

}  // namespace tether
