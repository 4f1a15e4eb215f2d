#pragma once

#include <filesystem>
#include <string>

#include "tools/experiment/store/data.hpp"
#include "tools/experiment/store/run_store.hpp"

namespace tether {

/// Data of the report page's interactive chart, as JSON: the series of the sweep's [figure]
/// (of a heat map: one for each y) with mean, interval, n and lost vehicles of each point, its
/// combination's number, and its runs as pairs of seed and value. Empty for figures that show no
/// means, or without runs. `data`: the figure's metric; `folder`: the report's. report.js reads it.
std::string chart_json(const RunStore& store, const SweepData& data,
                       const std::filesystem::path& folder);

}  // namespace tether
