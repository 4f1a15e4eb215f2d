#include "tools/experiment/report/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "tools/base/json.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/experiment/report/figure.hpp"
#include "tools/experiment/statistics/pareto.hpp"
#include "tools/experiment/sweep/data.hpp"
#include "tools/experiment/sweep/run_store.hpp"
#include "tools/experiment/sweep/sweeps_below.hpp"

namespace tether {
namespace {

using Json = nlohmann::ordered_json;  // NaN becomes null

Json point_json(const SweepData& data, std::size_t arm, double x) {
  const SweepData::ArmData& from = data.arms()[arm];
  Json runs = Json::array();
  for (const SeededValue& run : from.runs) runs.push_back({run.seed, run.value});
  const Interval& interval = from.summary.mean_interval;
  return {{"x", x},
          {"mean", from.summary.mean},
          {"low", interval.low},
          {"high", interval.high},
          {"n", from.summary.n},
          {"lost", from.survival.lost.count},
          {"arm", arm},
          {"runs", std::move(runs)}};
}

/// Data of the report page's interactive chart, as JSON: the series of the sweep's [figure]
/// (of a heat map: one for each y) with mean, interval, n and lost vehicles of each point, its
/// combination's number, and its runs as pairs of seed and value. Empty for figures that show no
/// means, or without runs. `data`: the figure's metric; `folder`: the report's. report.js reads it.
std::string chart_json(const RunStore& store, const SweepData& data,
                       const std::filesystem::path& folder) {
  const auto choice = store.figure();
  using Kind = FigureChoice::Kind;
  const bool has_means =
      choice && (choice->kind == Kind::curve || choice->kind == Kind::heatmap ||
                 choice->kind == Kind::comparison || choice->kind == Kind::pareto);
  if (!has_means || store.size() == 0) return "";

  std::optional<SweepData> across;  // pareto: what x is
  if (choice->kind == Kind::pareto) across.emplace(store, choice->x);
  const auto place_of = [&](std::size_t arm) {
    return across ? across->arms()[arm].summary.mean : x_of(data, *choice, arm);
  };
  Json names = Json::array();
  if (choice->kind == Kind::curve) {
    for (const std::string& name : names_of(data, *choice)) {
      names.push_back(label_of_value(data, choice->x, name));
    }
  }
  std::vector<Tradeoff> trades;
  std::vector<Json> drawn;
  Json series = Json::array();
  std::map<std::string, std::size_t> places;  // by the value of choice->y
  for (std::size_t arm = 0; arm < data.arms().size(); ++arm) {
    if (!is_selected(choice->where, data.arms()[arm].settings)) continue;
    if (!std::isfinite(place_of(arm))) continue;
    const std::string name = data.text(arm, choice->y);
    const auto [place, is_new] = places.emplace(name, series.size());
    if (is_new)
      series.push_back(
          {{"name", label_of_value(data, choice->y, name)}, {"points", Json::array()}});
    drawn.push_back(point_json(data, arm, place_of(arm)));
    trades.push_back({place_of(arm), data.arms()[arm].summary.mean});
    series[place->second]["points"].push_back(drawn.back());
  }
  if (across) {
    Json front = Json::array();
    for (const std::size_t i : pareto_front(trades)) front.push_back(drawn[i]);
    series.push_back({{"name", "front"}, {"points", std::move(front)}});
  }
  const bool is_log = choice->kind == Kind::comparison || across;
  const std::string x_name = across ? label_of_metric(choice->x) : label_of_key(choice->x);
  return json_text(
      Json{{"x_label", choice->x_label.empty() ? x_name : choice->x_label},
           {"y_label", choice->y_label.empty() ? label_of_metric(choice->metric) : choice->y_label},
           {"names", std::move(names)},
           {"log", is_log},
           {"reversed", choice->reversed},
           {"folder", store.file().parent_path().string()},
           {"report", folder.string()},
           {"runs_at", address_of_runs(folder, store.file())},
           {"series", std::move(series)}});
}

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
