#include "tools/experiment/sweep/experiment.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/base/toml_reader.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/loader.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/change.hpp"
#include "tools/experiment/statistics/statistics.hpp"
#include "tools/experiment/sweep/figure_choice.hpp"
#include "tools/experiment/sweep/gains.hpp"
#include "tools/experiment/sweep/grid.hpp"
#include "tools/experiment/sweep/section.hpp"
#include "tools/experiment/sweep/seeds.hpp"

namespace tether {
namespace {

constexpr std::size_t kSmallestBatch = kLeastSeeds;
constexpr std::int64_t kDefaultBatch = 20;

/// Refuses external controllers that would have to be started manually for each run.
void check_controllers(const std::vector<Arm>& arms, const std::string& file) {
  for (const Arm& arm : arms) {
    const auto& controller = arm.scenario.get<ControllerSettings>();
    check_command_has_url(controller, file);
    if (controller.ros2) {
      throw UsageError(
          file +
          ": controller.ros2 = true needs ROS 2 nodes that run: tether live, or tether "
          "run --processes, starts tether-ros2 for them");
    }
    if (!controller.external || !controller.command.empty()) continue;
    throw UsageError(fmt::format(
        "{}: controller.external = true without controller.command, which starts a controller of "
        "yours for each run; tether run and tether live wait for one that you start",
        file));
  }
}

std::optional<Precision> read_precision(const Section& file, const std::string& name) {
  const toml::table* table = file.table("precision");
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

/// Seeds are the sweep's.
void check_no_seed(const std::string& key, const std::string& place) {
  if (key != "run.seed") return;
  throw UsageError(fmt::format("{}: run.seed is every run's own: use seeds", place));
}

/// Keys of the grid cannot also be set in [set]. [set] may set what a named axis' points may
/// change.
void check_free(const std::string& key, const std::string& place, const std::vector<Axis>& axes,
                bool by_the_file) {
  check_no_seed(key, place);
  const auto others = ScenarioSchema::all()->keys_meant_by(key);
  for (const Axis& axis : axes) {
    const bool is_named = axis.keys.front().find('.') == std::string::npos;
    if (is_named && by_the_file) continue;
    for (const GridPoint& point : axis.points) {
      for (const PlacedSetting& applied : point.applied) {
        for (const std::string& meant : ScenarioSchema::all()->keys_meant_by(applied.setting.key)) {
          if (std::find(others.begin(), others.end(), meant) == others.end()) continue;
          throw UsageError(
              fmt::format("{}: {} is varied by the grid ({})", place, meant, applied.place));
        }
      }
    }
  }
}

std::string key_of(const std::string& text) { return text.substr(0, text.find('=')); }

/// Source of the arms.
struct ArmSource {
  std::string scenario_file, file;
  std::vector<std::string> overrides;
};

void add_arms(const ArmSource& from, const ScenarioLoader& start, const Part& part,
              std::vector<Arm>& arms) {
  for (const auto& [setting, place] : part.settings) {
    check_free(setting.key, place, part.axes, true);
  }
  for (const std::string& text : from.overrides) {
    check_free(key_of(text), "--set " + text, part.axes, false);
  }
  const std::filesystem::path folder = std::filesystem::path(from.file).parent_path();
  for (GridPoint& point : cross(part.axes)) {
    ScenarioLoader loader = start;
    const auto apply = [&loader](const PlacedSetting& given) {
      check_no_seed(given.setting.key, given.place);
      loader.apply_override(fmt::format("{}={}", given.setting.key, given.setting.value),
                            given.place);
    };
    std::for_each(part.settings.begin(), part.settings.end(), apply);
    std::for_each(point.applied.begin(), point.applied.end(), apply);
    loader.end_level(from.file, folder);
    for (const std::string& text : from.overrides) loader.apply_override(text, "--set " + text);
    loader.end_level("--set", {});
    arms.push_back({std::move(point.settings), loader.finish(from.scenario_file)});
  }
}

/// The file of tuned gains that the experiment names.
std::optional<Gains> gains_of(const Section& section, const std::string& file) {
  const std::string name = section.text("gains", "");
  if (name.empty()) return std::nullopt;
  return read_gains((std::filesystem::path(file).parent_path() / name).lexically_normal().string());
}

void check_no_arm_twice(const std::vector<Arm>& arms, const std::string& file) {
  std::set<std::string> seen;
  for (const Arm& arm : arms) {
    if (seen.insert(arm.text()).second) continue;
    throw UsageError(fmt::format("{}: two parts have the combination {}", file, arm.text()));
  }
}

}  // namespace

std::string KeyValue::plain() const {
  const bool is_quoted = value.size() >= 2 && (value.front() == '\'' || value.front() == '"') &&
                         value.front() == value.back();
  return is_quoted ? value.substr(1, value.size() - 2) : value;
}

bool is_selected(const Selection& selection, const std::vector<KeyValue>& settings) {
  return std::all_of(selection.begin(), selection.end(), [&settings](const auto& wanted) {
    return std::any_of(settings.begin(), settings.end(), [&wanted](const KeyValue& setting) {
      const auto& [key, values] = wanted;
      return setting.key == key &&
             std::find(values.begin(), values.end(), setting.plain()) != values.end();
    });
  });
}

std::string settings_text(const std::vector<KeyValue>& settings) {
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

Experiment load_experiment(const std::string& name, const std::vector<std::string>& overrides,
                           bool quick) {
  const std::string file = input_named(name);
  const toml::table table = read_toml(file, "the experiment file");
  const Section section(
      table, "", file,
      {"name", "scenario", "seeds", "quick_seeds", "common_random_numbers", "trajectory_period_s",
       "gains", "set", "grid", "zip", "axis", "part", "precision", "figure", "table"});
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
  if (experiment.precision && section.get("quick_seeds") != nullptr) {
    section.refuse("quick_seeds", "left out where [precision] says how many are needed");
  }
  if (experiment.precision) {
    for (std::size_t n = 1; n <= experiment.precision->most_seeds; ++n) {
      experiment.seeds.push_back(n);
    }
  } else {
    experiment.seeds = read_seeds(section, file);
    const auto all = static_cast<std::int64_t>(experiment.seeds.size());
    const std::int64_t few = std::min(section.whole("quick_seeds", 1, all), all);
    if (quick) experiment.seeds.resize(static_cast<std::size_t>(few));
  }
  experiment.common_random_numbers = section.boolean("common_random_numbers", true);
  experiment.trajectory_period_s = section.number("trajectory_period_s", 0.01, 1e6, 0.0);
  const std::optional<Gains> gains = gains_of(section, file);
  const std::vector<Part> parts =
      read_parts(table, file, [&](const PlacedSetting& given) { return expanded(given, gains); });
  experiment.keys = keys_of(parts.front().axes);
  experiment.figure = read_figure(section, file, experiment.keys);
  experiment.tables = read_tables(section, file, experiment.keys);
  const ArmSource source{(path.parent_path() / scenario).lexically_normal().string(), file,
                         overrides};
  const ScenarioLoader start = start_from_file(source.scenario_file);
  for (const Part& part : parts) add_arms(source, start, part, experiment.arms);
  check_no_arm_twice(experiment.arms, file);
  check_controllers(experiment.arms, file);
  check_choices(experiment, file);
  if (gains) check_disjoint(*gains, experiment, file);
  const std::uint64_t largest = *std::max_element(experiment.seeds.begin(), experiment.seeds.end());
  constexpr auto kMost = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  if (!experiment.common_random_numbers && largest >= kMost / experiment.arms.size()) {
    section.refuse("seeds", fmt::format("below {} where {} combinations have seeds of their own",
                                        kMost / experiment.arms.size(), experiment.arms.size()));
  }
  return experiment;
}

}  // namespace tether
