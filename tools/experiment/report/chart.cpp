#include "tools/experiment/report/chart.hpp"

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "tools/experiment/report/figure.hpp"
#include "tools/experiment/store/sweeps_below.hpp"

namespace tether {
namespace {

using Json = nlohmann::ordered_json;  // NaN becomes null

Json point_json(const SweepData& data, std::size_t arm, const std::string& x) {
  const SweepData::ArmData& from = data.arms()[arm];
  Json runs = Json::array();
  for (const SeededValue& run : from.runs) runs.push_back({run.seed, run.value});
  const Interval& interval = from.summary.mean_interval;
  return {{"x", data.number(arm, x)},
          {"mean", from.summary.mean},
          {"low", interval.low},
          {"high", interval.high},
          {"n", from.summary.n},
          {"lost", from.survival.lost.count},
          {"arm", arm},
          {"runs", std::move(runs)}};
}

}  // namespace

std::string chart_json(const RunStore& store, const SweepData& data,
                       const std::filesystem::path& folder) {
  const auto choice = store.figure();
  using Kind = FigureChoice::Kind;
  const bool has_means = choice && (choice->kind == Kind::curve || choice->kind == Kind::heatmap ||
                                    choice->kind == Kind::comparison);
  if (!has_means || store.size() == 0) return "";

  Json series = Json::array();
  std::map<std::string, std::size_t> places;  // by the value of choice->y
  for (std::size_t arm = 0; arm < data.arms().size(); ++arm) {
    if (!is_selected(choice->where, data.arms()[arm].settings)) continue;
    if (!std::isfinite(data.number(arm, choice->x))) continue;
    const std::string name = data.text(arm, choice->y);
    const auto [place, is_new] = places.emplace(name, series.size());
    if (is_new) series.push_back({{"name", name}, {"points", Json::array()}});
    series[place->second]["points"].push_back(point_json(data, arm, choice->x));
  }
  const bool is_comparison = choice->kind == Kind::comparison;
  return Json{{"x_label", choice->x_label.empty() ? label_of_key(choice->x) : choice->x_label},
              {"y_label", label_of_metric(choice->metric)},
              {"y", is_comparison ? "" : label_of_key(choice->y)},
              {"log", is_comparison},
              {"reversed", choice->reversed},
              {"folder", store.file().parent_path().string()},
              {"report", folder.string()},
              {"runs_at", address_of_runs(folder, store.file())},
              {"series", std::move(series)}}
      .dump();
}

}  // namespace tether
