#include "tools/runs/fleet_summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "tools/base/json.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

constexpr std::size_t kShownInWords = 5;

double metric_of(const char* name, const FleetObserver& fleet, Instant end) {
  return value_of(metrics()[*metric_number(name)], fleet.vehicles(), end);
}

std::int64_t lost_of(const FleetObserver& fleet) {
  return std::count_if(fleet.vehicles().begin(), fleet.vehicles().end(),
                       [](const RunObserver* one) { return one->truth().lost != 0; });
}

std::string ratio_text(const link_report_t& link) {
  return link.offered > 0 ? fmt::format("{:.3f}", reception_ratio(link)) : "-";
}

/// From the farthest off its path on.
std::vector<std::size_t> by_error(const FleetObserver& fleet) {
  std::vector<std::size_t> order(fleet.vehicles().size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const auto error = [&](std::size_t i) {
      return fleet.vehicles()[i]->truth().settled_epsilon_m;
    };
    return error(a) > error(b);
  });
  return order;
}

}  // namespace

std::string to_json(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary) {
  if (fleet.is_one()) return to_json(scenario, fleet.first(), summary);
  nlohmann::ordered_json json;
  json["vehicles"] = fleet.vehicles().size();
  for (const char* name : {"epsilon_m", "settled_epsilon_m", "worst_settled_epsilon_m",
                           "max_error_m", "aoi_ms_mean"}) {
    json[name] = metric_of(name, fleet, summary.end);
  }
  json["lost"] = lost_of(fleet);
  json["collisions"] = metric_of("collisions", fleet, summary.end);
  add_common(json, scenario, summary);
  for (std::size_t i = 0; i < fleet.vehicles().size(); ++i) {
    json["each"][fleet.names()[i]] =
        parse_ordered_json(to_json(scenario, *fleet.vehicles()[i], {.end = summary.end}));
  }
  return json_text(json, 2);
}

std::string to_text(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary) {
  if (fleet.is_one()) return to_text(scenario, fleet.first(), summary);
  const std::vector<std::size_t> order = by_error(fleet);
  std::string text = summary.findings ? verdict_text(*summary.findings) : "";
  text += fmt::format(
      "{:<9} {} vehicles: ε after the start {:.3f} m in the mean, {:.3f} m the worst; {} lost, "
      "{:g} collisions\n",
      "fleet", order.size(), metric_of("settled_epsilon_m", fleet, summary.end),
      metric_of("worst_settled_epsilon_m", fleet, summary.end), lost_of(fleet),
      metric_of("collisions", fleet, summary.end));
  text += fmt::format("{:<9} {:>8} {:>8} {:>10} {:>8} {:>8} {:>8}\n", "", "ε [m]", "after",
                      "largest", "PRR up", "down", "age [ms]");
  for (std::size_t n = 0; n < std::min(kShownInWords, order.size()); ++n) {
    const RunObserver& one = *fleet.vehicles()[order[n]];
    text +=
        fmt::format("{:<9} {:>8.3f} {:>8.3f} {:>10.3f} {:>8} {:>8} {:>8.0f}{}\n",
                    fleet.names()[order[n]], one.truth().epsilon_m, one.truth().settled_epsilon_m,
                    one.truth().max_error_m, ratio_text(one.uplink()), ratio_text(one.downlink()),
                    1e3 * one.aoi_mean_s(summary.end), one.truth().lost ? "  LOST" : "");
  }
  if (order.size() > kShownInWords) {
    text +=
        fmt::format("{:<9} {} more were nearer to their paths\n", "", order.size() - kShownInWords);
  }
  const auto counters = fleet.counters();
  text += sending_text(counters);
  text += medium_text(counters, summary.sim_time_s);
  return text + time_text(scenario, summary) + trouble_text(counters);
}

std::vector<std::string> fleet_now(const FleetObserver& fleet, Instant now) {
  if (fleet.is_one()) return {};
  const auto& vehicles = fleet.vehicles();
  const auto worst = std::max_element(vehicles.begin(), vehicles.end(),
                                      [](const RunObserver* a, const RunObserver* b) {
                                        return a->truth().epsilon_m < b->truth().epsilon_m;
                                      });
  return {fmt::format("ε {:.3f} m, worst {:.3f} m ({})", metric_of("epsilon_m", fleet, now),
                      (*worst)->truth().epsilon_m,
                      fleet.names()[static_cast<std::size_t>(worst - vehicles.begin())]),
          fmt::format("{} of {} lost, {:g} collisions", lost_of(fleet), vehicles.size(),
                      metric_of("collisions", fleet, now))};
}

}  // namespace tether
