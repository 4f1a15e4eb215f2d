#include "tools/experiment/report/figure.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "common/base/csv_table.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tools/experiment/figures/figures.hpp"
#include "tools/experiment/sweep/data.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

constexpr std::size_t kMostPanels = 6;

Scenario scenario_of(const RunStore& store, std::size_t arm) {
  return parse_scenario(store.arms().at(arm).scenario, "the sweep's scenario");
}

FigureText text_of(const RunStore& store) {
  FigureText text;
  text.title = store.figure()->title;
  text.plant = store.plant();
  text.experiment = store.name();
  return text;
}

/// The drawn arms by the value of the figure's y, each by ascending x.
std::vector<CurveSeries> series_of(const SweepData& data, const FigureChoice& choice) {
  std::vector<CurveSeries> all;
  std::map<std::string, std::size_t> places;  // by the value of choice.y
  for (std::size_t arm = 0; arm < data.arms().size(); ++arm) {
    const SweepData::ArmData& from = data.arms()[arm];
    if (!is_selected(choice.where, from.settings)) continue;
    const std::string name = data.text(arm, choice.y);
    const auto [place, is_new] = places.emplace(name, all.size());
    if (is_new) all.push_back({choice.y.empty() ? "" : label_of_value(data, choice.y, name), {}});
    all[place->second].points.push_back({x_of(data, choice, arm), values_of(from.runs),
                                         from.summary.mean, from.summary.mean_interval,
                                         from.has_two_humps ? from.survival.lost.count : 0});
  }
  for (CurveSeries& one : all) {
    std::sort(one.points.begin(), one.points.end(),
              [](const PlottedPoint& a, const PlottedPoint& b) { return a.x < b.x; });
  }
  return all;
}

/// Label of the figure's y axis, or of its colours.
std::string value_label(const FigureChoice& choice, const char* before) {
  return choice.y_label.empty() ? before + label_of_metric(choice.metric) : choice.y_label;
}

void draw_curve_of(const RunStore& store, const SweepData& data, const FigureChoice& choice,
                   const std::filesystem::path& folder, const std::string& stem) {
  CurveFigure figure;
  figure.text = text_of(store);
  figure.x_label = choice.x_label.empty() ? label_of_key(choice.x) : choice.x_label;
  figure.y_label = value_label(choice, "");
  for (const std::string& name : names_of(data, choice)) {
    figure.names.push_back(label_of_value(data, choice.x, name));
  }
  figure.series = series_of(data, choice);
  draw_curve(folder, stem, figure);
}

void draw_comparison_of(const RunStore& store, const SweepData& data, const FigureChoice& choice,
                        const std::filesystem::path& folder, const std::string& stem) {
  ComparisonFigure figure;
  figure.text = text_of(store);
  figure.text.height_cm = 8.2;
  figure.x_label = choice.x_label.empty() ? label_of_key(choice.x) : choice.x_label;
  figure.y_label = value_label(choice, "mean ");
  figure.note = choice.note;
  figure.floor = choice.floor;
  figure.reversed = choice.reversed;
  figure.series = series_of(data, choice);
  draw_comparison(folder, stem, figure);
}

/// Each arm's mean of the metric `x` beside that of the figure's own.
void draw_pareto_of(const RunStore& store, const SweepData& data, const FigureChoice& choice,
                    const std::filesystem::path& folder, const std::string& stem) {
  const SweepData across(store, choice.x);
  ParetoFigure figure;
  figure.text = text_of(store);
  figure.text.height_cm = 8.2;
  figure.x_label = "mean " + label_of_metric(choice.x);
  figure.y_label = value_label(choice, "mean ");
  std::map<std::string, std::size_t> places;
  for (std::size_t arm = 0; arm < data.arms().size(); ++arm) {
    const SweepData::ArmData& from = data.arms()[arm];
    if (!is_selected(choice.where, from.settings)) continue;
    const auto [place, is_new] = places.emplace(data.text(arm, choice.y), figure.series.size());
    if (is_new) figure.series.push_back({label_of_value(data, choice.y, place->first), {}});
    const Summary& x = across.arms()[arm].summary;
    figure.series[place->second].points.push_back(
        {x.mean, values_of(from.runs), from.summary.mean, from.summary.mean_interval,
         from.has_two_humps ? from.survival.lost.count : 0, x.mean_interval});
  }
  draw_pareto(folder, stem, figure);
}

void draw_heatmap_of(const RunStore& store, const SweepData& data, const FigureChoice& choice,
                     const std::filesystem::path& folder, const std::string& stem) {
  HeatmapFigure figure;
  figure.text = text_of(store);
  figure.x_label = label_of_key(choice.x);
  figure.y_label = label_of_key(choice.y);
  figure.value_label = value_label(choice, "mean ");
  for (const double x : data.values(choice.x)) {
    const std::vector<std::size_t> column = data.where(choice.x, x);
    std::vector<std::vector<SeededValue>> runs;
    for (const std::size_t arm : column) runs.push_back(data.arms()[arm].runs);
    const BestArm best = ties_of_best(runs, kConfidence, kBootstrapSeed);
    for (std::size_t i = 0; i < column.size(); ++i) {
      const Summary& summary = data.arms()[column[i]].summary;
      HeatCell cell{x,
                    data.number(column[i], choice.y),
                    summary.mean,
                    summary.mean_interval,
                    summary.n,
                    summary.left_out,
                    HeatCell::Mark::none};
      if (best.tied[i]) cell.mark = HeatCell::Mark::tied;
      if (best.best == i) cell.mark = HeatCell::Mark::best;
      figure.cells.push_back(cell);
    }
  }
  draw_heatmap(folder, stem, figure);
}

void draw_trajectories_of(const RunStore& store, const std::filesystem::path& folder,
                          const std::string& stem) {
  TrajectoryFigure figure;
  figure.text = text_of(store);
  figure.half_extent_m = scenario_of(store, 0).get<WorldSettings>().half_extent_m;
  const auto arms = store.arms();
  std::size_t next_arm = 0;  // the first run of each
  store.for_each(
      [&](const StoredRun& run) {
        const bool is_drawn = run.arm < next_arm || !run.result.failure.empty();
        if (is_drawn || figure.panels.size() == kMostPanels) return;
        next_arm = run.arm + 1;
        TrajectoryPanel panel;
        panel.title = "ε = " + fmt::format("{:.1f} m", run.result.metrics[0]);
        for (auto setting = arms[run.arm].settings.rbegin();
             setting != arms[run.arm].settings.rend(); ++setting) {
          panel.title =
              fmt::format("{}, {}", label_of_value(setting->key, setting->plain()), panel.title);
        }
        for (const TrajectoryPoint& row : run.result.trajectory) {
          panel.planned.push_back(
              {static_cast<double>(row.x_ref_m), static_cast<double>(row.y_ref_m)});
          panel.actual.push_back({static_cast<double>(row.x_m), static_cast<double>(row.y_m)});
        }
        figure.note = fmt::format("one run each, seed {}", run.seed);
        figure.panels.push_back(std::move(panel));
      },
      true);
  draw_trajectories(folder, stem, figure);
}

void draw_risk_map_of(const RunStore& store, const std::filesystem::path& folder,
                      const std::string& stem, RiskDefinition definition) {
  RiskMapFigure figure;
  figure.text = text_of(store);
  figure.half_extent_m = scenario_of(store, 0).get<WorldSettings>().half_extent_m;
  figure.failed = store.failures();
  figure.points = risk_points(store, definition);
  figure.turns = sharp_turns(figure.points);
  switch (definition) {
    case RiskDefinition::whole_run:
      figure.value_label = "mean ε [m]";
      figure.note =
          "ε is of the runs in which the channel was in its bad state (B) when the plan was here";
      break;
    case RiskDefinition::next_10_s:
      figure.value_label = "mean error [m]";
      figure.note = "the error is that of the next 10 s, where the channel was bad (B) here";
      break;
    case RiskDefinition::now:
      figure.value_label = "mean error [m]";
      break;
  }
  draw_risk_map(folder, stem, figure);
}

}  // namespace

bool draw_sweep_figure(const RunStore& store, const SweepData& data,
                       const std::filesystem::path& folder, const std::string& stem,
                       RiskDefinition risk) {
  const auto choice = store.figure();
  if (!choice || store.size() == 0) return false;
  switch (choice->kind) {
    case FigureChoice::Kind::curve:
      draw_curve_of(store, data, *choice, folder, stem);
      break;
    case FigureChoice::Kind::heatmap:
      draw_heatmap_of(store, data, *choice, folder, stem);
      break;
    case FigureChoice::Kind::comparison:
      draw_comparison_of(store, data, *choice, folder, stem);
      break;
    case FigureChoice::Kind::pareto:
      draw_pareto_of(store, data, *choice, folder, stem);
      break;
    case FigureChoice::Kind::trajectories:
      draw_trajectories_of(store, folder, stem);
      break;
    case FigureChoice::Kind::risk_map:
      draw_risk_map_of(store, folder, stem, risk);
      break;
  }
  return true;
}

std::vector<std::string> names_of(const SweepData& data, const FigureChoice& choice) {
  std::vector<std::string> names;
  bool are_numbers = true;
  for (std::size_t arm = 0; arm < data.arms().size(); ++arm) {
    if (!is_selected(choice.where, data.arms()[arm].settings)) continue;
    const std::string name = data.text(arm, choice.x);
    are_numbers = are_numbers && std::isfinite(data.number(arm, choice.x));
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
  return are_numbers ? std::vector<std::string>{} : names;
}

double x_of(const SweepData& data, const FigureChoice& choice, std::size_t arm) {
  const std::vector<std::string> names = names_of(data, choice);
  if (names.empty()) return data.number(arm, choice.x);
  const auto place = std::find(names.begin(), names.end(), data.text(arm, choice.x));
  return 1.0 + static_cast<double>(place - names.begin());
}

namespace {

/// Quantity of a key's values, and their unit: "sensor rate", "Hz".
std::pair<std::string, std::string> quantity_of(const std::string& key) {
  if (key.starts_with("channel.") && key.ends_with("prr")) return {"PRR", ""};
  if (key == "delay_ms" || (key.starts_with("channel.") && key.ends_with("delay_ms"))) {
    return {"δ", "ms"};
  }
  if (key == "controller.tau_s") return {"τ", "s"};
  static const std::map<std::string, std::string> kUnits{{"s", "s"},
                                                         {"ms", "ms"},
                                                         {"m", "m"},
                                                         {"mm", "mm"},
                                                         {"hz", "Hz"},
                                                         {"kg", "kg"},
                                                         {"rad", "rad"},
                                                         {"mps", "m/s"},
                                                         {"mps2", "m/s²"},
                                                         {"radps", "rad/s"},
                                                         {"db", "dB"},
                                                         {"us", "µs"},
                                                         {"bits_per_s", "bit/s"}};
  std::string words = key, unit;
  for (const auto& [end, name] : kUnits) {
    const bool has_unit = key.ends_with("_" + end) || key.ends_with("." + end);
    if (!has_unit || end.size() < key.size() - words.size()) continue;
    words = key.substr(0, key.size() - end.size() - 1);
    unit = name;
  }
  std::replace_if(
      words.begin(), words.end(), [](char c) { return c == '.' || c == '_'; }, ' ');
  return {words, unit};
}

}  // namespace

std::string label_of_value(const std::string& key, const std::string& value) {
  if (key == "controller.law") {
    static const std::map<std::string, std::string> kLaws{
        {"pid", "PID"}, {"pid_adaptive", "adaptive PID"}, {"mpc", "MPC"}};
    if (const auto law = kLaws.find(value); law != kLaws.end()) return law->second;
    std::string words = value;
    std::replace(words.begin(), words.end(), '_', ' ');
    return words;
  }
  if (key.ends_with(".file")) return std::filesystem::path(value).stem().string();
  const auto [words, unit] = quantity_of(key);
  const bool is_named = key.find('.') == std::string::npos && unit != "ms";
  if (value == "true" || value == "false") return (value == "true" ? "" : "no ") + words;
  if (is_named || !std::isfinite(finite_number(value))) return value;
  return fmt::format("{} {}{}{}", words, value, unit.empty() ? "" : " ", unit);
}

std::string label_of_value(const SweepData& data, const std::string& key,
                           const std::string& value) {
  std::string label = label_of_value(key, value);
  if (!key.ends_with(".file")) return label;
  for (std::size_t arm = 0; arm < data.arms().size(); ++arm) {
    const std::string other = data.text(arm, key);
    if (other == value || label_of_value(key, other) != label) continue;
    return std::filesystem::path(value).replace_extension().string();
  }
  return label;
}

std::string label_of_key(const std::string& key) {
  if (key.ends_with("trace.file")) return "trace";
  const auto [words, unit] = quantity_of(key);
  const bool is_symbol = words == "PRR" || words == "δ" || words == "τ";
  if (!is_symbol) return key;
  return unit.empty() ? words : fmt::format("{} [{}]", words, unit);
}

std::string label_of_metric(const std::string& metric) { return MetricExpression(metric).label(); }

}  // namespace tether
