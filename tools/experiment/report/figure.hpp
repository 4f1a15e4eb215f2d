#pragma once

#include <filesystem>
#include <string>

#include "tools/experiment/report/risk.hpp"
#include "tools/experiment/sweep/data.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// Draws what the sweep's [figure] asks for into `folder` as `stem` and .svg, .pdf, .png,
/// .csv and .gp; returns false, and draws nothing, if it has no figure or no runs. `data`: the
/// figure's metric.
bool draw_sweep_figure(const RunStore& store, const SweepData& data,
                       const std::filesystem::path& folder, const std::string& stem,
                       RiskDefinition risk);

/// "PRR", "δ [ms]", "τ [s]" or the key itself.
std::string label_of_key(const std::string& key);
/// A value for people: "PID", "PRR 0.45", "δ 100 ms", "sensor rate 20 Hz", "fade" of "fade.csv".
std::string label_of_value(const std::string& key, const std::string& value);
/// The same; two files of one name in a sweep have their folders with them: "floor1/fade".
std::string label_of_value(const SweepData& data, const std::string& key, const std::string& value);
/// The figure's values of x, in the order of arms, if they are not all numbers; else none.
std::vector<std::string> names_of(const SweepData& data, const FigureChoice& choice);
/// Where an arm is along x: the number, or 1 for the first of names_of().
double x_of(const SweepData& data, const FigureChoice& choice, std::size_t arm);
/// "ε [m]", "rms error [m]"…, or the expression
std::string label_of_metric(const std::string& metric);

}  // namespace tether
