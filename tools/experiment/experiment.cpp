#include "tools/experiment/experiment.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "common/channel_settings.hpp"
#include "common/errors.hpp"
#include "common/scenario_key_table.hpp"
#include "common/scenario_loader.hpp"
#include "tools/experiment/grid.hpp"
#include "tools/experiment/run_result.hpp"
#include "tools/experiment/statistics.hpp"

namespace tether {
namespace {

constexpr std::int64_t kMostSeeds = 1'000'000;
constexpr std::size_t kSmallestBatch = kLeastSeeds;
constexpr std::int64_t kDefaultBatch = 20;

/// A table of the experiment file, which must have these keys and no others.
class Section {
 public:
  Section(const toml::table& table, std::string name, std::string file,
          const std::set<std::string>& known)
      : table_(table), name_(std::move(name)), file_(std::move(file)) {
    for (const auto& [key, node] : table) {
      if (known.contains(std::string(key.str()))) continue;
      throw UsageError(fmt::format("{}:{}: unknown key \"{}{}\"; allowed: {}", file_,
                                   node.source().begin.line, name_, key.str(),
                                   fmt::join(known, ", ")));
    }
  }

  const toml::node* get(const std::string& key) const { return table_.get(key); }

  std::string text(const std::string& key, const std::string& otherwise) const {
    const toml::node* node = table_.get(key);
    if (node == nullptr) return otherwise;
    if (!node->is_string()) refuse(key, "a text");
    return *node->value<std::string>();
  }
  double number(const std::string& key, double low, double high, double otherwise) const {
    const toml::node* node = table_.get(key);
    if (node == nullptr) return otherwise;
    const auto value = node->is_number() ? node->value<double>() : std::nullopt;
    if (!value || !(*value >= low && *value <= high)) {
      refuse(key, fmt::format("a number in [{}, {}]", low, high));
    }
    return *value;
  }
  std::int64_t whole(const std::string& key, std::int64_t low, std::int64_t otherwise) const {
    const toml::node* node = table_.get(key);
    if (node == nullptr) return otherwise;
    const auto* value = node->as_integer();
    if (value == nullptr || value->get() < low || value->get() > kMostSeeds) {
      refuse(key, fmt::format("a whole number from {} to {}", low, kMostSeeds));
    }
    return value->get();
  }
  bool boolean(const std::string& key, bool otherwise) const {
    const toml::node* node = table_.get(key);
    if (node == nullptr) return otherwise;
    if (!node->is_boolean()) refuse(key, "true or false");
    return *node->value<bool>();
  }
  std::string metric(const std::string& key) const {
    std::string name = text(key, "epsilon_m");
    if (!metric_number(name)) refuse(key, fmt::format("one of {}", fmt::join(kMetricNames, ", ")));
    return name;
  }

  [[noreturn]] void refuse(const std::string& key, const std::string& allowed) const {
    const toml::node* node = table_.get(key);
    const auto line = (node == nullptr ? table_.source() : node->source()).begin.line;
    throw UsageError(fmt::format("{}:{}: {}{} must be {}", file_, line, name_, key, allowed));
  }

 private:
  const toml::table& table_;
  std::string name_;  // "precision."
  std::string file_;
};

toml::table parse_file(const std::string& file) {
  try {
    return toml::parse_file(file);
  } catch (const toml::parse_error& error) {
    if (!error.source().begin) {
      throw UsageError(fmt::format("cannot read the experiment file \"{}\"", file));
    }
    throw UsageError(
        fmt::format("{}:{}: {}", file, error.source().begin.line, error.description()));
  }
}

/// seeds = 50, or a list; `quick`: quick_seeds, if there are.
std::vector<std::uint64_t> read_seeds(const Section& file, bool quick) {
  std::vector<std::uint64_t> seeds;
  const toml::node* node = file.get("seeds");
  const auto* list = node == nullptr ? nullptr : node->as_array();
  if (list == nullptr) {
    if (node == nullptr) file.refuse("seeds", "given: how many, or a list of them");
    const std::int64_t all = file.whole("seeds", 1, 1);
    const std::int64_t few = file.whole("quick_seeds", 1, all);
    const auto count = static_cast<std::uint64_t>(quick ? std::min(few, all) : all);
    for (std::uint64_t seed = 1; seed <= count; ++seed) seeds.push_back(seed);
    return seeds;
  }
  std::set<std::int64_t> seen;
  for (const toml::node& entry : *list) {
    const auto* seed = entry.as_integer();
    if (seed == nullptr || seed->get() < 0 || !seen.insert(seed->get()).second) {
      file.refuse("seeds", "whole numbers from 0 on, each once");
    }
    seeds.push_back(static_cast<std::uint64_t>(seed->get()));
  }
  if (seeds.empty()) file.refuse("seeds", "one seed or more");
  return seeds;
}

bool is_number(const std::string& text) {
  double value = 0.0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  return failed == std::errc{} && end == text.data() + text.size();
}

const toml::table* table_of(const Section& section, const std::string& key) {
  const toml::node* node = section.get(key);
  if (node == nullptr) return nullptr;
  if (!node->is_table()) section.refuse(key, fmt::format("a table, [{}]", key));
  return node->as_table();
}

std::optional<Precision> read_precision(const Section& file, const std::string& name) {
  const toml::table* table = table_of(file, "precision");
  if (table == nullptr) return std::nullopt;
  const Section section(*table, "precision.", name,
                        {"metric", "half_width", "most_seeds", "batch"});
  if (file.get("seeds") != nullptr) {
    file.refuse("seeds", "left out where [precision] says how many are needed");
  }
  Precision precision;
  precision.metric = section.metric("metric");
  precision.half_width = section.number("half_width", 1e-12, 1e12, 0.0);
  if (precision.half_width == 0.0) section.refuse("half_width", "given, in the metric's unit");
  precision.batch = static_cast<std::size_t>(section.whole("batch", kSmallestBatch, kDefaultBatch));
  precision.most_seeds = static_cast<std::size_t>(
      section.whole("most_seeds", static_cast<std::int64_t>(precision.batch), 0));
  if (precision.most_seeds == 0) section.refuse("most_seeds", "given: seeds of an arm at most");
  return precision;
}

std::optional<FigureChoice> read_figure(const Section& file, const std::string& name,
                                        const std::vector<std::string>& grid) {
  const toml::table* table = table_of(file, "figure");
  if (table == nullptr) return std::nullopt;
  const Section section(*table, "figure.", name, {"kind", "x", "y", "metric", "title"});
  using Kind = FigureChoice::Kind;
  const std::vector<std::pair<std::string, Kind>> kinds{{"curve", Kind::curve},
                                                        {"heatmap", Kind::heatmap},
                                                        {"trajectories", Kind::trajectories},
                                                        {"risk_map", Kind::risk_map}};
  const std::string kind = section.text("kind", "curve");
  const auto found =
      std::find_if(kinds.begin(), kinds.end(), [&](const auto& k) { return k.first == kind; });
  if (found == kinds.end()) {
    section.refuse("kind", "\"curve\", \"heatmap\", \"trajectories\" or \"risk_map\"");
  }
  FigureChoice figure{found->second, section.text("x", ""), section.text("y", ""),
                      section.metric("metric"), section.text("title", "")};
  const bool has_axes = figure.kind == Kind::curve || figure.kind == Kind::heatmap;
  const auto check_axis = [&](const char* key, const std::string& value, bool needed) {
    const bool is_varied = std::find(grid.begin(), grid.end(), value) != grid.end();
    if (value.empty() ? needed : !is_varied) {
      section.refuse(key, fmt::format("a key that the grid varies: {}", fmt::join(grid, ", ")));
    }
  };
  check_axis("x", figure.x, has_axes);
  check_axis("y", figure.y, figure.kind == Kind::heatmap);
  return figure;
}

/// Refuses figures that cannot be drawn from the runs, before they are made.
void check_figure(const FigureChoice& figure, const Experiment& experiment,
                  const std::vector<Axis>& axes, const std::string& file) {
  const auto refuse = [&file](const std::string& why) {
    throw UsageError(fmt::format("{}: [figure]: {}", file, why));
  };
  using Kind = FigureChoice::Kind;
  if (figure.kind == Kind::trajectories || figure.kind == Kind::risk_map) {
    if (experiment.trajectory_period_s > 0.0) return;
    refuse("trajectories and risk maps need trajectory_period_s");
  }
  constexpr std::size_t kMostSeries = 7;
  for (const Axis& axis : axes) {
    const auto has = [&axis](const std::string& key) {
      return std::find(axis.keys.begin(), axis.keys.end(), key) != axis.keys.end();
    };
    const bool is_x = has(figure.x), is_y = has(figure.y);
    if (!is_x && !is_y) {
      refuse(fmt::format("{} varies too, but is neither x nor y: its values would be mixed",
                         axis.keys.front()));
    }
    if (figure.kind == Kind::curve && is_y && !is_x && axis.points.size() > kMostSeries) {
      refuse(fmt::format("a curve has at most {} series, and {} has {} values", kMostSeries,
                         figure.y, axis.points.size()));
    }
    for (const auto& point : axis.points) {
      for (const auto& [key, value] : point) {
        const bool must_be_number =
            key == figure.x || (key == figure.y && figure.kind == Kind::heatmap);
        if (!must_be_number || is_number(value)) continue;
        refuse(fmt::format("{} = {} is no number, as an axis needs", key, value));
      }
    }
  }
}

/// [set], as overrides with their places.
std::vector<std::pair<std::string, std::string>> read_settings(const Section& file,
                                                               const std::string& name) {
  std::vector<std::pair<std::string, std::string>> settings;
  const toml::table* table = table_of(file, "set");
  if (table == nullptr) return settings;
  for (const PlacedNode& given : flatten(*table, name)) {
    settings.emplace_back(given.key + "=" + value_text(*given.node), given.place);
  }
  return settings;
}

/// Seeds are the sweep's, and what the grid varies cannot be set besides.
void check_free(const std::string& key, const std::string& place, const std::vector<Axis>& axes) {
  if (key == "run.seed") {
    throw UsageError(fmt::format("{}: run.seed is every run's own: use seeds", place));
  }
  for (const Axis& axis : axes) {
    for (const std::string& varied : axis.keys) {
      for (const std::string& meant : keys_meant_by(varied)) {
        const auto others = keys_meant_by(key);
        if (std::find(others.begin(), others.end(), meant) == others.end()) continue;
        throw UsageError(
            fmt::format("{}: {} is varied by the grid ({})", place, meant, axis.place));
      }
    }
  }
}

std::string key_of(const std::string& text) { return text.substr(0, text.find('=')); }

std::vector<Arm> make_arms(const std::string& scenario_file, const std::string& file,
                           const std::vector<std::pair<std::string, std::string>>& settings,
                           const std::vector<std::string>& overrides,
                           const std::vector<Axis>& axes) {
  for (const auto& [text, place] : settings) check_free(key_of(text), place, axes);
  for (const std::string& text : overrides) check_free(key_of(text), "--set " + text, axes);
  const ScenarioLoader start = start_from_file(scenario_file);
  const std::filesystem::path folder = std::filesystem::path(file).parent_path();
  std::map<std::string, std::string> places;
  for (const Axis& axis : axes) {
    for (const std::string& key : axis.keys) {
      if (key == "run.seed") check_free(key, axis.place, {});
      places[key] = axis.place;
    }
  }
  std::vector<Arm> arms;
  for (auto& point : cross(axes)) {
    ScenarioLoader loader = start;
    for (const auto& [text, place] : settings) loader.apply_override(text, place);
    for (const auto& [key, value] : point)
      loader.apply_override(fmt::format("{}={}", key, value), places[key]);
    loader.end_level(file, folder);
    for (const std::string& text : overrides) loader.apply_override(text, "--set " + text);
    loader.end_level("--set", {});
    Arm arm{std::move(point), loader.finish(scenario_file)};
    check_changes(arm.scenario, scenario_file);
    arms.push_back(std::move(arm));
  }
  return arms;
}

}  // namespace

std::string KeyValue::plain() const {
  const bool is_quoted = value.size() >= 2 && (value.front() == '\'' || value.front() == '"') &&
                         value.front() == value.back();
  return is_quoted ? value.substr(1, value.size() - 2) : value;
}

std::string Arm::text() const {
  std::string text;
  for (const KeyValue& setting : settings) {
    text += fmt::format("{}{} = {}", text.empty() ? "" : ", ", setting.key, setting.plain());
  }
  return text.empty() ? "all runs" : text;
}

std::uint64_t Experiment::seed(std::size_t arm, std::size_t n) const {
  return seeds[n] + (common_random_numbers ? 0 : arm * stride());
}

std::optional<std::size_t> Experiment::number(std::size_t arm, std::uint64_t seed) const {
  const std::uint64_t first = common_random_numbers ? 0 : arm * stride();
  if (seed < first) return std::nullopt;
  const std::uint64_t wanted = seed - first;
  if (wanted >= 1 && wanted <= seeds.size() && seeds[wanted - 1] == wanted) return wanted - 1;
  const auto found = std::find(seeds.begin(), seeds.end(), wanted);
  if (found == seeds.end()) return std::nullopt;
  return static_cast<std::size_t>(found - seeds.begin());
}

std::uint64_t Experiment::stride() const {
  return *std::max_element(seeds.begin(), seeds.end()) + 1;
}

Experiment load_experiment(const std::string& file, const std::vector<std::string>& overrides,
                           bool quick) {
  const toml::table table = parse_file(file);
  const Section section(table, "", file,
                        {"name", "scenario", "seeds", "quick_seeds", "common_random_numbers",
                         "trajectory_period_s", "set", "grid", "zip", "precision", "figure"});
  const std::filesystem::path path(file);
  Experiment experiment;
  experiment.overrides = overrides;
  experiment.name = section.text("name", path.stem().string());
  if (!is_identifier(experiment.name)) {
    section.refuse("name", "letters, digits, '-' and '_', at most 32");
  }
  const std::string scenario = section.text("scenario", "");
  if (scenario.empty()) section.refuse("scenario", "given: a scenario file");
  experiment.precision = read_precision(section, file);
  const toml::node* seeds = section.get("seeds");
  if (section.get("quick_seeds") != nullptr && (seeds == nullptr || !seeds->is_integer())) {
    section.refuse("quick_seeds", "left out, unless seeds is a number");
  }
  if (experiment.precision) {
    for (std::size_t n = 1; n <= experiment.precision->most_seeds; ++n) {
      experiment.seeds.push_back(n);
    }
  } else {
    experiment.seeds = read_seeds(section, quick);
  }
  experiment.common_random_numbers = section.boolean("common_random_numbers", true);
  experiment.trajectory_period_s = section.number("trajectory_period_s", 0.01, 1e6, 0.0);
  const std::vector<Axis> axes = read_axes(table, file);
  for (const Axis& axis : axes) {
    experiment.keys.insert(experiment.keys.end(), axis.keys.begin(), axis.keys.end());
  }
  experiment.figure = read_figure(section, file, experiment.keys);
  if (experiment.figure) check_figure(*experiment.figure, experiment, axes, file);
  experiment.arms = make_arms((path.parent_path() / scenario).lexically_normal().string(), file,
                              read_settings(section, file), overrides, axes);
  const std::uint64_t largest = *std::max_element(experiment.seeds.begin(), experiment.seeds.end());
  constexpr auto kMost = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  if (!experiment.common_random_numbers && largest >= kMost / experiment.arms.size()) {
    section.refuse("seeds", fmt::format("below {} where {} combinations have seeds of their own",
                                        kMost / experiment.arms.size(), experiment.arms.size()));
  }
  return experiment;
}

}  // namespace tether
