#include "tools/runs/run_summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

#include "common/base/text.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/version.hpp"
#include "controller/tube/reach_tube.hpp"
#include "tools/base/json.hpp"
#include "tools/runs/channel_report.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

nlohmann::ordered_json link_json(const link_report_t& link) {
  nlohmann::ordered_json json;
  json["sent"] = link.offered;
  json["delivered"] = link.delivered;
  json["lost"] = link.lost;
  json["overflowed"] = link.overflowed;
  json["in_flight"] = link.in_flight;
  json["prr"] = nullptr;
  if (link.offered > 0) json["prr"] = reception_ratio(link);
  json["delay_ms_mean"] = link.delay_ms_mean;
  json["delay_ms_p50"] = link.delay_ms_p50;
  json["delay_ms_p99"] = link.delay_ms_p99;
  json["delay_ms_max"] = link.delay_ms_max;
  return json;
}

std::string link_text(const char* name, const link_report_t& link) {
  if (link.offered == 0) return fmt::format("{:<9} nothing sent\n", name);
  return fmt::format(
      "{:<9} {} sent, {} delivered, {} lost (PRR {:.3f}), delay mean {:.1f} ms, p99 {:.1f} ms\n",
      name, link.offered, link.delivered, link.lost + link.overflowed, reception_ratio(link),
      link.delay_ms_mean, link.delay_ms_p99);
}

double real_time_factor(const RunSummary& s) {
  return s.wall_time_s > 0.0 ? s.sim_time_s / s.wall_time_s : 0.0;
}

double over_floor(const LockstepCost& cost) {
  return cost.wall_time_s / (static_cast<double>(cost.grants) * *cost.round_trip_s);
}

nlohmann::ordered_json drivetrain_json(const DrivetrainObserver& d) {
  nlohmann::ordered_json json;
  json["state"] = d.state().state_name;
  json["reason"] = d.state().reason;
  json["ever_armed"] = d.ever_armed();
  json["armed_s"] = d.armed_s();
  json["disarms"] = d.state().disarms;
  json["stopped_at_s"] = nullptr;
  if (!d.stop_reason().empty()) json["stopped_at_s"] = d.stopped_at_s();
  json["stop_reason"] = d.stop_reason();
  json["odometry_distance_m"] = d.odometry_distance_m();
  json["true_distance_m"] = d.true_distance_m();
  json["odometry_error_m"] = d.odometry_error_m();
  return json;
}

std::string drivetrain_text(const DrivetrainObserver& d) {
  std::string text;
  if (!d.ever_armed()) {
    text = fmt::format("{:<9} never armed: {}: {}\n", "drives", d.state().state_name,
                       d.state().reason);
  } else {
    text =
        fmt::format("{:<9} {}, armed for {:.1f} s\n", "drives", d.state().state_name, d.armed_s());
  }
  if (!d.stop_reason().empty()) {
    text += fmt::format("{:<9} at {:.2f} s: {}\n", "stopped", d.stopped_at_s(), d.stop_reason());
  }
  return text + fmt::format("{:<9} {:.2f} m of {:.2f} m ({:+.2f} %), {:.2f} m off at the end\n",
                            "odometry", d.odometry_distance_m(), d.true_distance_m(),
                            d.true_distance_m() > 0.0
                                ? 100.0 * (d.odometry_distance_m() / d.true_distance_m() - 1.0)
                                : 0.0,
                            d.odometry_error_m());
}

void add_metrics(nlohmann::ordered_json& json, Metric::InSummary where, const RunObserver& run,
                 Instant end) {
  for (const Metric& metric : metrics()) {
    if (metric.in_summary == where) json[metric.name] = metric.of(run, end);
  }
}

/// How the vehicle did after the start, where there was a time after it, and whether it was lost.
std::string settled_text(const ground_truth_t& truth, const RunSettings& run, double sim_time_s) {
  std::string text;
  if (sim_time_s > run.settled_from_s) {
    text = fmt::format("{:<9} from {:g} s on: ε = {:.3f} m, largest {:.2f} m\n", "settled",
                       run.settled_from_s, truth.settled_epsilon_m, truth.settled_max_error_m);
  }
  if (!truth.lost) return text;
  if (truth.return_s < run.lost_for_s) {  // it never came back
    return text + fmt::format("{:<9} from {:.1f} s on\n", "LOST", truth.lost_from_s);
  }
  text += fmt::format("{:<9} at {:.1f} s, back after {:.1f} s at most", "LOST", truth.lost_from_s,
                      truth.return_s);
  if (truth.away_s > 0.0) text += fmt::format(", away for the last {:.1f} s", truth.away_s);
  return text + "\n";
}

/// Counters of what must not happen in a healthy run.
bool is_trouble(const std::string& name) {
  if (name.starts_with("netem.medium.") && !name.ends_with(".too_long")) return false;
  for (const char* ordinary : {".accepted", ".missed", ".sent", ".received", ".boots", ".offered",
                               ".delivered", ".lost", ".sampled", ".decided"}) {
    if (name.ends_with(ordinary)) return false;
  }
  return true;
}

}  // namespace

std::string verdict_text(const std::vector<std::string>& findings) {
  if (findings.empty()) return "valid     one run on this network, one of each node, all alive\n";
  std::string text = "INVALID   the numbers below are not those of this scenario\n";
  for (const std::string& finding : findings) text += fmt::format("{:<9} {}\n", "", finding);
  return text;
}

std::string medium_text(const std::map<std::string, std::int64_t>& counters, double sim_time_s) {
  const auto count = [&counters](const char* name) {
    const auto found = counters.find(fmt::format("netem.medium.{}", name));
    return found == counters.end() ? 0 : found->second;
  };
  if (count("sent") == 0) return "";
  std::string text = fmt::format("{:<9} {} sent, {} delivered, {} lost", "medium", count("sent"),
                                 count("delivered"), count("lost"));
  std::string reasons;
  for (const auto& [name, meaning] : {std::pair{"lost.attempts", "after all attempts"},
                                      {"lost.no_room", "by a full queue"},
                                      {"lost.late", "as too late to be sent"},
                                      {"too_long", "as too long"}}) {
    if (count(name) == 0) continue;
    reasons += fmt::format("{}{} {}", reasons.empty() ? " (" : ", ", count(name), meaning);
  }
  if (!reasons.empty()) text += reasons + ")";
  if (const std::int64_t all = count("transmissions"); all > 0) {
    text += fmt::format("; {} of all {} transmissions collided, busy {:.1f} % of the time",
                        count("collisions"), all,
                        1e-4 * static_cast<double>(count("busy_us")) / sim_time_s);
  }
  return text + "\n";
}

std::string sending_text(const std::map<std::string, std::int64_t>& counters) {
  std::string text;
  const auto add = [&](const std::string& of, const std::string& all, const char* what) {
    const auto sent = counters.find(of + ".sent"), made = counters.find(of + all);
    if (sent == counters.end() || made == counters.end() || made->second == 0) return;
    text += fmt::format(
        "{}{} of {} {} ({:.1f} %)", text.empty() ? "" : ", ", sent->second, made->second, what,
        100.0 * static_cast<double>(sent->second) / static_cast<double>(made->second));
  };
  add("sim.pose", ".sampled", "poses");
  add("controller.command", ".decided", "commands");
  return text.empty() ? "" : fmt::format("{:<9} {}\n", "changed", text);
}

void add_common(nlohmann::ordered_json& json, const Scenario& scenario, const RunSummary& summary) {
  if (summary.findings) {
    json["valid"] = summary.findings->empty();
    json["invalid_because"] = *summary.findings;
  }
  json["sim_time_s"] = summary.sim_time_s;
  json["wall_time_s"] = summary.wall_time_s;
  json["real_time_factor"] = real_time_factor(summary);
  json["plant"] = scenario.get<VehicleSettings>().plant_name();
  json["seed"] = scenario.get<RunSettings>().seed;
  json["version"] = kVersion;
}

std::string time_text(const Scenario& scenario, const RunSummary& summary) {
  std::string text =
      fmt::format("{:<9} {:.2f} s simulated in {:.2f} s ({:.0f} x real time), {} plant, seed {}\n",
                  "time", summary.sim_time_s, summary.wall_time_s, real_time_factor(summary),
                  scenario.get<VehicleSettings>().plant_name(), scenario.get<RunSettings>().seed);
  if (!summary.lockstep) return text;
  const LockstepCost& cost = *summary.lockstep;
  text += fmt::format("{:<9} {} grants in {:.2f} s", "lockstep", cost.grants, cost.wall_time_s);
  if (cost.round_trip_s) {
    text += fmt::format(": {:.2f} x as many round trips of {:.0f} us", over_floor(cost),
                        *cost.round_trip_s * 1e6);
  }
  return text + "\n";
}

std::string trouble_text(const std::map<std::string, std::int64_t>& counters) {
  std::string text;
  for (const auto& [name, value] : counters) {
    if (value > 0 && is_trouble(name)) {
      text += fmt::format("{:<9} {} = {}\n", "counter", name, value);
    }
  }
  return text;
}

double reception_ratio(const link_report_t& link) {
  return 1.0 - static_cast<double>(link.lost + link.overflowed) / static_cast<double>(link.offered);
}

void check_finite(const RunObserver& run) {
  const ground_truth_t& truth = run.truth();
  if (std::isfinite(truth.epsilon_m) && std::isfinite(truth.rmse_m)) return;
  throw std::runtime_error(
      fmt::format("the run is invalid: its error came out as {} m", truth.epsilon_m));
}

std::string to_json(const Scenario& scenario, const RunObserver& run, const RunSummary& summary) {
  nlohmann::ordered_json json;
  add_metrics(json, Metric::InSummary::first, run, summary.end);
  json["lost"] = run.truth().lost != 0;
  json["lost_from_s"] = nullptr;
  if (run.truth().lost) json["lost_from_s"] = run.truth().lost_from_s;
  json["collision"] = run.truth().wall_contact_s > 0.0;
  add_common(json, scenario, summary);
  if (summary.tube_m) {
    json["tube"] = {{"silence_s", scenario.get<TubeSettings>().silence_s},
                    {"deviation_m", *summary.tube_m}};
  }
  json["uplink"] = link_json(run.uplink());
  json["downlink"] = link_json(run.downlink());
  if (summary.channel) {
    json["uplink"].update(to_json(summary.channel->uplink));
    json["downlink"].update(to_json(summary.channel->downlink));
  }
  add_metrics(json, Metric::InSummary::last, run, summary.end);
  if (run.autonomy()) {
    json["autonomy"] = {{"state", printable(run.autonomy()->state_name, 40)},
                        {"handovers", run.autonomy()->handover},
                        {"late_s", run.autonomy()->late_s}};
  }
  if (run.drivetrain()) json["drivetrain"] = drivetrain_json(*run.drivetrain());
  if (summary.lockstep) {
    const LockstepCost& cost = *summary.lockstep;
    json["lockstep"]["grants"] = cost.grants;
    json["lockstep"]["wall_time_s"] = cost.wall_time_s;
    if (cost.round_trip_s) {
      json["lockstep"]["round_trip_us_median"] = *cost.round_trip_s * 1e6;
      json["lockstep"]["over_floor"] = over_floor(cost);
    }
  }
  json["node_restarts"] = summary.node_restarts;
  json["counters"] = run.counters();
  // Names come from the network and may be no UTF-8.
  return json_text(json, 2);
}

std::string to_text(const Scenario& scenario, const RunObserver& run, const RunSummary& summary) {
  const ground_truth_t& truth = run.truth();
  std::string text = summary.findings ? verdict_text(*summary.findings) : "";
  text += fmt::format("ε = {:.3f} m   (rms {:.3f} m, largest {:.2f} m, at the walls {:.1f} s)\n",
                      truth.epsilon_m, truth.rmse_m, truth.max_error_m, truth.wall_contact_s);
  text += settled_text(truth, scenario.get<RunSettings>(), summary.sim_time_s);
  if (summary.tube_m) {
    text += fmt::format("{:<9} after {:g} s of silence at most {:.3f} m from its plan\n", "tube",
                        scenario.get<TubeSettings>().silence_s, *summary.tube_m);
  }
  text += sending_text(run.counters());
  text += medium_text(run.counters(), summary.sim_time_s);
  text += link_text("uplink", run.uplink());
  if (summary.channel) text += to_text(summary.channel->uplink);
  text += link_text("downlink", run.downlink());
  if (summary.channel) text += to_text(summary.channel->downlink);
  text += fmt::format("{:<9} mean age of the controller's pose {:.0f} ms\n", "age",
                      run.aoi_mean_s(summary.end) * 1e3);
  if (run.autonomy()) {
    text += fmt::format("autonomy  {}, {:.1f} s late on its path, the driver changed {} times\n",
                        printable(run.autonomy()->state_name, 40), run.autonomy()->late_s,
                        run.autonomy()->handover);
  }
  if (run.drivetrain()) text += drivetrain_text(*run.drivetrain());
  text += time_text(scenario, summary);
  if (summary.node_restarts > 0) {
    text += fmt::format("{:<9} {} node restarts: the result is not that of an undisturbed run\n",
                        "note", summary.node_restarts);
  }
  return text + trouble_text(run.counters());
}

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
