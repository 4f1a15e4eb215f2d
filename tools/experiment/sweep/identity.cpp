#include "tools/experiment/sweep/identity.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <variant>

#include "common/base/errors.hpp"
#include "common/base/fnv1a.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/version.hpp"
#include "common/world/occupancy_map.hpp"
#include "common/world/surroundings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/settings.hpp"
#include "tools/base/json.hpp"
#include "tools/experiment/sweep/figure_choice.hpp"
#include "tools/experiment/sweep/run_store.hpp"
#include "tools/experiment/sweep/seeds.hpp"

namespace tether {
namespace {

std::string precision_text(const std::optional<Precision>& precision) {
  if (!precision) return "none";
  return fmt::format("{} to ±{}, {} seeds at most, in batches of {}", precision->metric,
                     precision->half_width, precision->most_seeds, precision->batch);
}

std::string hash_of_file(const std::string& file) {
  return fmt::format("{:016x}", fnv1a(read_input(file, "the scenario's file", kMostTableBytes)));
}

/// The words of a command that are files, such as a user's script.
std::set<std::string> files_in(const std::string& command) {
  std::set<std::string> files;
  std::string word;
  bool is_quoted = false;
  for (const char c : command + ' ') {
    if (c == '\'') {  // the key takes no other quotes, and no backslashes
      is_quoted = !is_quoted;
    } else if (c != ' ' || is_quoted) {
      word += c;
    } else {
      if (std::error_code none; std::filesystem::is_regular_file(word, none)) files.insert(word);
      word.clear();
    }
  }
  return files;
}

/// The files that a scenario names, and that those name.
std::set<std::string> files_of(Scenario scenario) {
  std::set<std::string> files;
  for (const ScenarioKey& key : scenario.schema().keys_of(scenario)) {
    if (!key.file || scenario.schema().left_out(scenario, key)) continue;
    if (const std::string& file = key.file(scenario); !file.empty()) files.insert(file);
  }
  for (const ChannelSettings::Change& change : scenario.get<ChannelSettings>().changes) {
    for (const std::string& setting : change.settings) {
      if (const auto file = file_of_setting(setting)) files.insert(*file);
    }
  }
  if (const std::string& map = scenario.get<Surroundings>().map_file; !map.empty()) {
    files.insert(load_occupancy_map(map).image_file);
  }
  files.merge(files_in(scenario.get<ControllerSettings>().command));
  return files;
}

std::string inputs_text(const Experiment& experiment) {
  std::set<std::string> files;
  for (const Arm& arm : experiment.arms) files.merge(files_of(arm.scenario));
  std::string text;
  for (const std::string& file : files) {
    text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", file, hash_of_file(file));
  }
  return text.empty() ? "none" : text;
}

std::string plants_text(const Experiment& experiment) {
  std::set<std::string> plants;
  for (const Arm& arm : experiment.arms)
    plants.insert(arm.scenario.get<VehicleSettings>().plant_name());
  return fmt::format("{}", fmt::join(plants, ", "));
}

[[noreturn]] void refuse(const RunStore& store, const std::string& what, const std::string& was,
                         const std::string& is) {
  throw UsageError(fmt::format(
      "{} was made with {} = {}; now it is {}. Go on as it was, or choose another --out",
      store.file().string(), what, was, is));
}

}  // namespace

Identity identity_of(const Experiment& experiment, const Shard& shard) {
  return {{"name", experiment.name},
          {"version", kVersion},
          {"plant", plants_text(experiment)},
          {"seeds", seeds_text(experiment.seeds)},
          {"precision", precision_text(experiment.precision)},
          {"common_random_numbers", experiment.common_random_numbers ? "true" : "false"},
          {"trajectory_period_s", fmt::format("{}", experiment.trajectory_period_s)},
          {"overrides", fmt::format("{}", fmt::join(experiment.overrides, " "))},
          {"keys", json_text(nlohmann::json(experiment.keys))},
          {"inputs", inputs_text(experiment)},
          {"figure", to_text(experiment.figure)},
          {"tables", to_text(experiment.tables)},
          {"planned_runs", fmt::format("{}", experiment.arms.size() * experiment.seeds.size())},
          {"shard", to_text(shard)}};
}

void check_same(const RunStore& store, const Identity& identity) {
  const Identity stored = store.identity();
  for (const auto& [key, value] : identity) {
    if (key == "figure" || key == "tables" || key == "planned_runs") continue;  // change no run
    const auto found = stored.find(key);
    const std::string was = found == stored.end() ? "nothing" : found->second;
    if (was != value) refuse(store, key, was, value);
  }
}

void check_same_arms(const RunStore& store, const Experiment& experiment) {
  const auto stored = store.arms();
  if (stored.size() != experiment.arms.size()) {
    refuse(store, "combinations", std::to_string(stored.size()),
           std::to_string(experiment.arms.size()));
  }
  for (std::size_t i = 0; i < stored.size(); ++i) {
    const Arm& arm = experiment.arms[i];
    if (stored[i].settings != arm.settings) {
      refuse(store, fmt::format("combination {}", i), settings_text(stored[i].settings),
             arm.text());
    }
    std::istringstream was(stored[i].scenario), is(to_toml(arm.scenario));
    std::string was_line, is_line;
    for (;;) {
      const bool more = static_cast<bool>(std::getline(was, was_line));
      if (static_cast<bool>(std::getline(is, is_line)) != more || (more && was_line != is_line)) {
        refuse(store, "the scenario's line", "\"" + was_line + "\"", "\"" + is_line + "\"");
      }
      if (!more) break;
    }
  }
}

std::string to_text(const Shard& shard) { return fmt::format("{}/{}", shard.index, shard.count); }

Shard shard_of(const std::string& text) {
  const std::string_view all = text;
  const std::size_t slash = std::min(all.find('/'), all.size());
  const auto index = to_number<std::size_t>(all.substr(0, slash));
  const auto count = to_number<std::size_t>(all.substr(std::min(slash + 1, all.size())));
  if (index && count && *index >= 1 && *index <= *count) return {*index, *count};
  throw UsageError(fmt::format("shard \"{}\" must be I/N, from 1/N to N/N", text));
}

}  // namespace tether
