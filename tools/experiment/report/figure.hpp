#pragma once

#include <filesystem>
#include <string>

#include "tools/experiment/report/risk.hpp"
#include "tools/experiment/store/data.hpp"
#include "tools/experiment/store/run_store.hpp"

namespace tether {

/// Draws what the sweep's [figure] asks for into `folder` as `stem` and .svg, .pdf, .png,
/// .csv and .gp; returns false, and draws nothing, if it has no figure or no runs. `data`: the
/// figure's metric.
bool draw_sweep_figure(const RunStore& store, const SweepData& data,
                       const std::filesystem::path& folder, const std::string& stem,
                       RiskDefinition risk);

/// "PRR", "δ [ms]", "τ [s]" or the key itself.
std::string label_of_key(const std::string& key);
/// "ε [m]", "rms error [m]"…
std::string label_of_metric(const std::string& metric);

}  // namespace tether
