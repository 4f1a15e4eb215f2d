#include "tools/experiment/report/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "tools/base/write_file.hpp"
#include "tools/experiment/report/chart.hpp"
#include "tools/experiment/report/figure.hpp"
#include "tools/experiment/store/data.hpp"
#include "tools/experiment/store/sweeps_below.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{:.4g}", value) : "-";
}

bool has_losses(const SweepData::ArmData& arm) { return arm.survival.lost.count > 0; }

constexpr std::array kLossHeads{"lost [95 %]", "mean of the others [95 %]",
                                "back after [s] [95 %]"};

/// Cells: share of lost vehicles, errors of the others, and times until vehicles returned.
std::array<std::string, kLossHeads.size()> loss_cells(const SweepData::ArmData& arm) {
  if (arm.survival.lost.n == 0) return {"-", "-", "-"};
  std::string back = mean_text(arm.returns.times);
  if (arm.returns.times.n > 0) back += fmt::format(", n = {}", arm.returns.times.n);
  if (arm.returns.not_back > 0) back += fmt::format("; {} not back", arm.returns.not_back);
  return {share_text(arm.survival.lost), mean_text(arm.survival.survivors), back};
}

std::vector<std::vector<std::string>> table_of(const RunStore& store, const SweepData& data) {
  std::vector<std::string> head = store.keys();
  for (const char* column : {"n", "failed", "mean [95 %]", "sd", "median [95 %]", "5 %", "95 %",
                             "largest", "minus the first [95 %]"}) {
    head.emplace_back(column);
  }
  head.insert(head.end(), kLossHeads.begin(), kLossHeads.end());
  std::vector<std::vector<std::string>> table{head};
  for (const SweepData::ArmData& arm : data.arms()) {
    std::vector<std::string> row;
    for (const KeyValue& setting : arm.settings) row.push_back(setting.plain());
    const Summary& s = arm.summary;
    const bool has_interval = std::isfinite(s.median_interval.low);
    const auto difference =
        paired_difference(arm.runs, data.arms().front().runs, kConfidence, kBootstrapSeed);
    for (const std::string& cell :
         {std::to_string(s.n), std::to_string(s.left_out),
          arm.has_two_humps ? "two humps" : mean_text(s), number(s.sd),
          number(s.median) + (has_interval ? " " + interval_text(s.median_interval) : ""),
          number(s.q05), number(s.q95), number(s.max), mean_text(difference.difference)}) {
      row.push_back(cell);
    }
    for (const std::string& cell : loss_cells(arm)) row.push_back(cell);
    table.push_back(row);
  }
  if (std::none_of(data.arms().begin(), data.arms().end(), has_losses)) {
    for (auto& row : table) row.resize(row.size() - kLossHeads.size());
  }
  return table;
}

void add_results(const RunStore& store, SweepData data, RiskDefinition risk,
                 PaperResults& results) {
  const std::string name = store.name();
  if (name == "f5_risk" && store.size() > 0) results.risk = risk_fall(store, risk);
  if (data.metric() != "epsilon_m") return;
  std::optional<SweepData>* result = nullptr;
  if (name == "f2_prr") {
    result = &results.prr;
    results.prr_by_command = by_command(store);
  }
  if (name == "f3_delay") result = &results.delay;
  if (name == "f4_tau") result = &results.heatmap;
  if (result != nullptr) *result = std::move(data);
}

ReportSection make_section(const RunStore& store, const SweepData& data, const fs::path& folder,
                           const std::string& stem, RiskDefinition risk) {
  ReportSection section;
  const auto figure = store.figure();
  const Identity identity = store.identity();
  section.name = store.name();
  section.title = figure && !figure->title.empty() ? figure->title : store.name();
  if (stem != store.name()) section.title += " (" + stem + ")";
  section.version = store.version();
  section.plant = store.plant();
  section.seeds = identity.at("seeds");
  section.is_common = identity.at("common_random_numbers") == "true";
  if (const auto found = identity.find("overrides"); found != identity.end()) {
    section.overrides = found->second;  // sweeps of older versions do not say
  }
  section.scenario = store.arms().front().scenario;
  section.wall_time_s = store.wall_time_s();
  section.runs = store.size();
  section.failed = store.failures();
  section.planned = store.planned_runs();
  section.is_complete = store.is_complete();
  if (draw_sweep_figure(store, data, folder, stem, risk)) section.figure = stem;
  section.chart = chart_json(store, data, folder);
  section.table = table_of(store, data);
  section.tables = tables_of(store);
  for (std::size_t i = 0; i < section.tables.size(); ++i) {
    section.table_files.push_back(fmt::format("{}_table{}.csv", stem, i + 1));
    write_file(folder / section.table_files.back(), section.tables[i].csv);
  }
  return section;
}

}  // namespace

Report write_report(const fs::path& folder, RiskDefinition risk) {
  Report report;
  PaperResults results;
  std::vector<RunStore> stores;
  std::map<std::string, int> sweeps_of_name;
  for (const fs::path& file : databases_below(folder)) {
    stores.push_back(RunStore::open(file));
    ++sweeps_of_name[stores.back().name()];
  }
  for (const RunStore& store : stores) {
    const auto figure = store.figure();
    SweepData data(store, figure ? figure->metric : "epsilon_m");
    // Several sweeps of one experiment are named after their folders, and no claim is judged by
    // them.
    const bool is_only = sweeps_of_name[store.name()] == 1;
    const std::string stem =
        is_only ? store.name() : store.file().parent_path().filename().string();
    report.sections.push_back(make_section(store, data, folder, stem, risk));
    if (is_only) add_results(store, std::move(data), risk, results);
  }
  report.title = report.sections.size() == 1 ? report.sections.front().title
                                             : "AGV control over a lossy, delayed network";
  report.claims = judge_claims(results);
  write_file(folder / "report.html", to_html(report, folder));
  write_file(folder / "report.md", to_markdown(report));
  return report;
}

}  // namespace tether
