#include "tools/experiment/design/run_result.hpp"

#include <algorithm>

namespace tether {

std::optional<std::size_t> metric_number(std::string_view name) {
  const auto found = std::find(kMetricNames.begin(), kMetricNames.end(), name);
  if (found == kMetricNames.end()) return std::nullopt;
  return static_cast<std::size_t>(found - kMetricNames.begin());
}

}  // namespace tether
