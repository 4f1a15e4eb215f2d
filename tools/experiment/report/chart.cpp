#include "tools/experiment/report/chart.hpp"

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "tools/base/json.hpp"
#include "tools/experiment/report/figure.hpp"
#include "tools/experiment/statistics/pareto.hpp"
#include "tools/experiment/store/sweeps_below.hpp"

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

}  // namespace

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

}  // namespace tether
