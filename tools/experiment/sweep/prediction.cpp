#include "tools/experiment/sweep/prediction.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sodium.h>

#include <algorithm>
#include <array>
#include <boost/algorithm/string/classification.hpp>
#include <boost/algorithm/string/split.hpp>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <set>
#include <sstream>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"
#include "tools/base/json.hpp"
#include "tools/experiment/sweep/data.hpp"

namespace tether {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::uintmax_t kMostPredictionBytes = std::uintmax_t{16} << 20;

double log_choose(double n, double k) {
  return std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0);
}

double log_beta(double a, double b) { return std::lgamma(a) + std::lgamma(b) - std::lgamma(a + b); }

std::string blake2b(const std::string& text) {
  std::array<unsigned char, 32> hash{};
  crypto_generichash(hash.data(), hash.size(), reinterpret_cast<const unsigned char*>(text.data()),
                     text.size(), nullptr, 0);
  return fmt::format("{:02x}", fmt::join(hash, ""));
}

struct Runs {
  std::size_t runs = 0;
  std::size_t lost = 0;
  std::vector<double> values;
};

/// The runs of each arm, in order.
std::vector<Runs> runs_of(const RunStore& store, const std::string& metric) {
  const SweepData values(store, metric), lost(store, "lost");
  std::vector<Runs> all(values.arms().size());
  for (std::size_t arm = 0; arm < all.size(); ++arm) {
    Runs& runs = all[arm];
    const auto& of_lost = lost.arms()[arm].runs;
    for (std::size_t i = 0; i < of_lost.size(); ++i) {
      if (std::isnan(of_lost[i].value)) continue;  // failed
      ++runs.runs;
      const double value = values.arms()[arm].runs[i].value;
      if (of_lost[i].value > 0.5) {
        ++runs.lost;
      } else if (std::isfinite(value)) {
        runs.values.push_back(value);
      }
    }
  }
  return all;
}

std::vector<std::uint64_t> seeds_of(const RunStore& store) {
  std::set<std::uint64_t> seeds;
  store.for_each([&](const StoredRun& run) { seeds.insert(run.seed); });
  return {seeds.begin(), seeds.end()};
}

bool same_value(const std::string& a, const std::string& b) {
  const auto x = to_number<double>(a), y = to_number<double>(b);
  return x && y ? std::abs(*x - *y) <= 1e-9 * std::max(1.0, std::abs(*x)) : a == b;
}

bool same_settings(const std::vector<KeyValue>& a, const std::vector<KeyValue>& b) {
  return a.size() == b.size() && std::ranges::all_of(a, [&](const KeyValue& one) {
           return std::ranges::any_of(b, [&](const KeyValue& other) {
             return one.key == other.key && same_value(one.plain(), other.plain());
           });
         });
}

Json without_digest(const Prediction& prediction) {
  Json arms = Json::array();
  for (const PredictedArm& arm : prediction.arms) {
    Json settings = Json::object();
    for (const KeyValue& setting : arm.settings) settings[setting.key] = setting.value;
    arms.push_back({{"settings", settings},
                    {"runs", arm.runs},
                    {"lost", arm.lost},
                    {"values", arm.values},
                    {"beyond", arm.beyond},
                    {"low", arm.interval.low},
                    {"high", arm.interval.high}});
  }
  return {{"tether_prediction", 1},
          {"name", prediction.name},
          {"version", prediction.version},
          {"plant", prediction.plant},
          {"scenarios", prediction.scenarios},
          {"metric", prediction.metric},
          {"tolerance", prediction.tolerance},
          {"seeds", prediction.seeds},
          {"arms", arms}};
}

double number_or_nan(const Json& value) {
  return value.is_null() ? std::nan("") : value.get<double>();
}

Prediction from_json(const Json& json) {
  Prediction p;
  p.name = json.at("name");
  p.version = json.at("version");
  p.plant = json.at("plant");
  p.scenarios = json.at("scenarios");
  p.metric = json.at("metric");
  p.tolerance = json.at("tolerance");
  p.seeds = json.at("seeds").get<std::vector<std::uint64_t>>();
  for (const Json& entry : json.at("arms")) {
    PredictedArm& arm = p.arms.emplace_back();
    for (const auto& [key, value] : entry.at("settings").items()) {
      arm.settings.push_back({key, value.get<std::string>()});
    }
    arm.runs = entry.at("runs");
    arm.lost = entry.at("lost");
    arm.values = entry.at("values");
    arm.beyond = entry.at("beyond");
    arm.interval = {number_or_nan(entry.at("low")), number_or_nan(entry.at("high"))};
  }
  return p;
}

/// The measured arm with these settings, made where it is new.
MeasuredArm& arm_of(std::vector<MeasuredArm>& all, const std::vector<KeyValue>& settings) {
  const auto found = std::ranges::find_if(
      all, [&](const MeasuredArm& arm) { return same_settings(arm.settings, settings); });
  if (found != all.end()) return *found;
  all.push_back({settings, 0, 0, {}});
  return all.back();
}

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  boost::split(cells, line, boost::is_any_of(","));
  for (std::string& cell : cells) cell = trimmed(cell);
  return cells;
}

/// Where in a table's head each column is.
struct Columns {
  std::vector<std::pair<std::string, std::size_t>> keys;
  std::size_t metric = 0;
  std::optional<std::size_t> lost;

  Columns(const std::vector<std::string>& head, const Prediction& prediction,
          const std::string& file) {
    const auto place = [&](const std::string& name) -> std::optional<std::size_t> {
      const auto found = std::ranges::find(head, name);
      if (found == head.end()) return std::nullopt;
      return static_cast<std::size_t>(found - head.begin());
    };
    const auto needed = [&](const std::string& name) {
      if (const auto at = place(name)) return *at;
      throw UsageError(
          fmt::format("{}, line 1: no column {}: a prediction of {} needs it, and each key that "
                      "its settings have",
                      file, in_quotes(name), prediction.metric));
    };
    for (const KeyValue& setting : prediction.arms.front().settings) {
      keys.emplace_back(setting.key, needed(setting.key));
    }
    metric = needed(prediction.metric);
    lost = place("lost");
  }
};

}  // namespace

double PredictedArm::coverage() const {
  return 1.0 - 2.0 * static_cast<double>(beyond) / (static_cast<double>(values) + 1.0);
}

bool PredictedArm::operator==(const PredictedArm& other) const {
  const auto same = [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); };
  return settings == other.settings && runs == other.runs && lost == other.lost &&
         values == other.values && beyond == other.beyond &&
         same(interval.low, other.interval.low) && same(interval.high, other.interval.high);
}

Prediction predict(const RunStore& store, const std::string& metric, double tolerance) {
  if (!store.is_complete()) {
    throw UsageError(fmt::format("{} is not complete: run its `tether sweep` to its end",
                                 store.file().string()));
  }
  const auto arms = store.arms();
  std::string scenarios;
  for (const auto& arm : arms) scenarios += arm.scenario;
  Prediction result;
  result.name = store.name();
  result.version = store.version();
  result.plant = store.plant();
  result.scenarios = blake2b(scenarios);
  result.metric = metric;
  result.tolerance = tolerance;
  result.seeds = seeds_of(store);
  const std::vector<Runs> all = runs_of(store, metric);
  for (std::size_t i = 0; i < arms.size(); ++i) {
    std::vector<double> values = all[i].values;
    std::ranges::sort(values);
    PredictedArm arm{arms[i].settings, all[i].runs, all[i].lost, values.size(), 1, {}};
    const double most = (1.0 - kPredicted) / 2.0 * static_cast<double>(values.size() + 1);
    arm.beyond = std::max<std::size_t>(1, static_cast<std::size_t>(most + 1e-9));
    if (values.size() >= 2) {
      arm.interval = {values[arm.beyond - 1], values[values.size() - arm.beyond]};
    }
    result.arms.push_back(std::move(arm));
  }
  return result;
}

std::string digest_of(const Prediction& prediction) {
  return blake2b(json_text(without_digest(prediction)));
}

std::string to_json(const Prediction& prediction) {
  Json json = without_digest(prediction);
  json["digest"] = digest_of(prediction);
  return json_text(json, 1) + "\n";
}

Prediction read_prediction(const std::string& file) {
  const std::string text = read_input(file, "the prediction", kMostPredictionBytes);
  try {
    const Json json = parse_ordered_json(text);
    if (json.at("tether_prediction") != 1) throw UsageError("\"tether_prediction\" must be 1");
    Prediction prediction = from_json(json);
    if (json.at("digest") != digest_of(prediction)) {
      throw UsageError(
          "\"digest\" is not that of the contents: the file was changed after `tether predict` had "
          "written it");
    }
    for (const PredictedArm& arm : prediction.arms) {
      if (arm.lost + arm.values <= arm.runs && arm.beyond >= 1) continue;
      throw UsageError(settings_text(arm.settings) + ": numbers of runs contradict each other");
    }
    if (prediction.arms.empty()) throw UsageError("\"arms\" must not be empty");
    return prediction;
  } catch (const std::exception& e) {
    throw UsageError(fmt::format("{}: not a prediction: {}", file, printable(e.what())));
  }
}

std::vector<MeasuredArm> measured_in(const RunStore& store, const Prediction& prediction) {
  if (store.version() == prediction.version && store.plant() == prediction.plant) {
    for (const std::uint64_t seed : seeds_of(store)) {
      if (!std::ranges::binary_search(prediction.seeds, seed)) continue;
      throw UsageError(
          fmt::format("{}: seed {} is one of the prediction's own runs: measure with other seeds",
                      store.file().string(), seed));
    }
  }
  const auto arms = store.arms();
  std::vector<Runs> all = runs_of(store, prediction.metric);
  std::vector<MeasuredArm> measured;
  for (std::size_t i = 0; i < arms.size(); ++i) {
    measured.push_back({arms[i].settings, all[i].runs, all[i].lost, std::move(all[i].values)});
  }
  return measured;
}

std::vector<MeasuredArm> measured_in_table(const std::string& file, const Prediction& prediction) {
  std::istringstream text(read_input(file, "the table", kMostTableBytes));
  std::string line;
  std::getline(text, line);
  const std::vector<std::string> head = cells_of(line);
  const Columns columns(head, prediction, file);
  std::vector<MeasuredArm> all;
  for (std::size_t number = 2; std::getline(text, line); ++number) {
    if (trimmed(line).empty()) continue;
    const auto refuse = [&](std::size_t column, const std::string& allowed) {
      throw UsageError(fmt::format("{}, line {}: column {} must be {}", file, number,
                                   in_quotes(head.at(column)), allowed));
    };
    const std::vector<std::string> cells = cells_of(line);
    if (cells.size() != head.size()) {
      throw UsageError(fmt::format("{}, line {}: {} cells, and the head has {}", file, number,
                                   cells.size(), head.size()));
    }
    std::vector<KeyValue> settings;
    for (const auto& [key, column] : columns.keys) settings.push_back({key, cells[column]});
    MeasuredArm& arm = arm_of(all, settings);
    ++arm.runs;
    if (columns.lost && cells[*columns.lost] != "0" && cells[*columns.lost] != "1") {
      refuse(*columns.lost, "0 or 1");
    }
    if (columns.lost && cells[*columns.lost] == "1") {
      ++arm.lost;
      continue;
    }
    const auto value = to_number<double>(cells[columns.metric]);
    if (!value || !std::isfinite(*value)) refuse(columns.metric, "a finite number");
    arm.values.push_back(*value);
  }
  return all;
}

double probability_of_so_few_within(std::size_t k, std::size_t m, std::size_t n,
                                    std::size_t beyond) {
  const double of = static_cast<double>(m), b = 2.0 * static_cast<double>(beyond);
  const double a = static_cast<double>(n) + 1.0 - b;
  double sum = 0.0;
  for (std::size_t i = 0; i <= k; ++i) {
    const auto x = static_cast<double>(i);
    sum += std::exp(log_choose(of, x) + log_beta(x + a, of - x + b) - log_beta(a, b));
  }
  return std::min(sum, 1.0);
}

double fisher_exact(std::size_t a, std::size_t n, std::size_t b, std::size_t m) {
  const std::size_t all = a + b;
  const auto log_p = [&](std::size_t x) {
    return log_choose(static_cast<double>(n), static_cast<double>(x)) +
           log_choose(static_cast<double>(m), static_cast<double>(all - x)) -
           log_choose(static_cast<double>(n + m), static_cast<double>(all));
  };
  constexpr double kRounding = 1e-7;
  const double here = log_p(a) + kRounding;
  double sum = 0.0;
  for (std::size_t x = all > m ? all - m : 0; x <= std::min(all, n); ++x) {
    if (log_p(x) <= here) sum += std::exp(log_p(x));
  }
  return std::min(sum, 1.0);
}

std::vector<bool> not_rejected_by_holm(const std::vector<double>& p_values, double level) {
  std::vector<std::size_t> order(p_values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return p_values[i]; });
  std::vector<bool> stays(p_values.size(), true);
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (p_values[order[i]] > level / static_cast<double>(order.size() - i)) break;
    stays[order[i]] = false;
  }
  return stays;
}

std::vector<CheckedArm> check_prediction(const Prediction& prediction,
                                         const std::vector<MeasuredArm>& measured) {
  std::vector<const MeasuredArm*> of(prediction.arms.size(), nullptr);
  for (const MeasuredArm& arm : measured) {
    const auto found = std::ranges::find_if(prediction.arms, [&](const PredictedArm& p) {
      return same_settings(p.settings, arm.settings);
    });
    if (found == prediction.arms.end()) {
      throw UsageError(
          fmt::format("{}: was measured, and not predicted", settings_text(arm.settings)));
    }
    of[static_cast<std::size_t>(found - prediction.arms.begin())] = &arm;
  }
  std::vector<CheckedArm> checked;
  std::vector<double> p_values;
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (of[i] == nullptr || of[i]->runs == 0) continue;
    const PredictedArm& p = prediction.arms[i];
    CheckedArm& c = checked.emplace_back();
    c.predicted = &p;
    c.runs = of[i]->runs;
    c.lost = of[i]->lost;
    c.values = of[i]->values.size();
    const Interval wide{p.interval.low - prediction.tolerance,
                        p.interval.high + prediction.tolerance};
    c.within = static_cast<std::size_t>(
        std::ranges::count_if(of[i]->values, [&](double value) { return contains(wide, value); }));
    if (c.values > 0 && p.values >= 2) {
      c.p_within = probability_of_so_few_within(c.within, c.values, p.values, p.beyond);
    }
    c.p_lost = fisher_exact(p.lost, p.runs, c.lost, c.runs);
    p_values.push_back(c.p_within);
    p_values.push_back(c.p_lost);
  }
  if (checked.empty()) throw UsageError("nothing was measured");
  const std::vector<bool> stays = not_rejected_by_holm(p_values, kFalseAlarms);
  for (std::size_t i = 0; i < checked.size(); ++i) {
    checked[i].within_holds = stays[2 * i];
    checked[i].lost_holds = stays[2 * i + 1];
  }
  return checked;
}

}  // namespace tether
