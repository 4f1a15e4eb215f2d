#include "tools/experiment/sweep/never_commanded.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/statistics/statistics.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

/// The packet reception ratio of a link that does nothing else to packets.
std::optional<double> plain_prr(const toml::node_view<const toml::node>& link) {
  constexpr std::array kHarmless{"model", "prr", "delay_ms", "queue_limit", "queue_limit_bytes"};
  const toml::table* table = link.as_table();
  if (table == nullptr || link["model"].value_or(std::string()) != "fixed") return std::nullopt;
  if (link["delay_ms"].value_or(1.0) != 0.0) return std::nullopt;
  for (const auto& [key, node] : *table) {
    if (std::find(kHarmless.begin(), kHarmless.end(), key.str()) == kHarmless.end())
      return std::nullopt;
  }
  return link["prr"].value<double>();
}

/// Data of an arm, gathered by by_command().
struct Gathered {
  std::vector<double> all, never, commanded;  // ε
  std::optional<double> poses;
  bool is_one_command_a_pose = true;

  void add(const RunResult& run) {
    static const std::size_t kSent = metric_number("uplink_sent").value(),
                             kLost = metric_number("uplink_lost").value(),
                             kAnswered = metric_number("downlink_sent").value(),
                             kUnheard = metric_number("downlink_lost").value();
    const auto& m = run.metrics;
    if (!run.failure.empty()) return;
    is_one_command_a_pose = is_one_command_a_pose && m[kAnswered] == m[kSent] - m[kLost] &&
                            poses.value_or(m[kSent]) == m[kSent];
    poses = m[kSent];
    all.push_back(m[0]);
    (m[kAnswered] == m[kUnheard] ? never : commanded).push_back(m[0]);
  }
};

std::vector<Gathered> gather(const RunStore& store, std::size_t arms) {
  std::vector<Gathered> gathered(arms);
  store.for_each([&](const StoredRun& run) { gathered.at(run.arm).add(run.result); });
  return gathered;
}

CommandedRuns judge(const Gathered& arm, const std::string& scenario) {
  CommandedRuns result{arm.all.size(), arm.never.size(), std::nullopt, {}};
  if (!arm.poses || !arm.is_one_command_a_pose) return result;
  result.probability = never_commanded_probability(scenario, static_cast<std::size_t>(*arm.poses));
  if (!result.probability) return result;
  const double p = *result.probability;
  result.epsilon_m =
      stratified_mean({{p, arm.never}, {1.0 - p, arm.commanded}}, kConfidence, kBootstrapSeed);
  return result;
}

std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{:.6g}", value) : "";
}

}  // namespace

std::optional<double> never_commanded_probability(const std::string& scenario, std::size_t poses) {
  const toml::table resolved = toml::parse(scenario);
  const toml::node_view<const toml::node> all(resolved);
  if (all["controller"]["trigger"].value_or(std::string()) != "event") return std::nullopt;
  if (all["channel"]["changes"]) return std::nullopt;
  const auto up = plain_prr(all["channel"]["uplink"]), down = plain_prr(all["channel"]["downlink"]);
  if (!up || !down) return std::nullopt;
  return std::pow(1.0 - *up * *down, static_cast<double>(poses));
}

std::vector<CommandedRuns> by_command(const RunStore& store) {
  const auto arms = store.arms();
  const auto gathered = gather(store, arms.size());
  std::vector<CommandedRuns> result;
  for (std::size_t arm = 0; arm < arms.size(); ++arm) {
    result.push_back(judge(gathered[arm], arms[arm].scenario));
  }
  return result;
}

void export_stratified(const RunStore& store,
                       const std::function<void(const std::string&)>& write) {
  const auto arms = store.arms();
  std::string head = "arm";
  for (const std::string& key : store.keys()) head += "," + csv_cell(key);
  write(head +
        ",runs,never,never_expected,epsilon_m,epsilon_m_low,epsilon_m_high,stratified_m,"
        "stratified_m_low,stratified_m_high\n");
  const auto gathered = gather(store, arms.size());
  for (std::size_t arm = 0; arm < arms.size(); ++arm) {
    const CommandedRuns runs = judge(gathered[arm], arms[arm].scenario);
    const Summary plain = summarize(gathered[arm].all, kConfidence, kBootstrapSeed);
    std::string row = fmt::format("{}", arm);
    for (const KeyValue& setting : arms[arm].settings) row += "," + csv_cell(setting.plain());
    row += fmt::format(",{},{},", runs.runs, runs.never);
    if (runs.probability) row += number(*runs.probability * static_cast<double>(runs.runs));
    for (const double x :
         {plain.mean, plain.mean_interval.low, plain.mean_interval.high, runs.epsilon_m.mean,
          runs.epsilon_m.interval.low, runs.epsilon_m.interval.high}) {
      row += "," + number(x);
    }
    write(row + "\n");
  }
}

}  // namespace tether
