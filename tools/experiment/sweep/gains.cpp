#include "tools/experiment/sweep/gains.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "common/base/errors.hpp"
#include "common/base/toml_reader.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/section.hpp"
#include "tools/experiment/sweep/section.hpp"
#include "tools/experiment/sweep/seeds.hpp"

namespace tether {
namespace {

constexpr double kLargest = kInfinity;

/// A list of texts, or of numbers.
template <class T>
std::vector<T> list_of(const Section& section, const std::string& key, const char* allowed) {
  const toml::node* node = section.get(key);
  const toml::array* list = node == nullptr ? nullptr : node->as_array();
  if (list == nullptr) section.refuse(key, allowed);
  std::vector<T> values;
  for (const toml::node& entry : *list) {
    const std::optional<T> value = entry.value<T>();
    if (!value) section.refuse(key, allowed);
    values.push_back(*value);
  }
  return values;
}

std::vector<KeyValue> settings_of(const Section& section, const std::string& key,
                                  const std::string& file) {
  const toml::table* table = section.table(key);
  if (table == nullptr) section.refuse(key, "given: a table of scenario keys");
  std::vector<KeyValue> settings;
  for (const PlacedNode& given : flatten(*table, file)) {
    settings.push_back({given.key, value_text(*given.node)});
  }
  return settings;
}

TunedLaw read_law(const PlacedNode& given, const std::string& file) {
  const toml::table* table = given.node->as_table();
  if (table == nullptr) {
    throw UsageError(fmt::format("{}: law.\"{}\" must be a table", given.place, given.key));
  }
  const Section section(*table, fmt::format("law.\"{}\".", given.key), file,
                        {"version", "conditions", "seeds", "evaluations", "found", "before",
                         "after", "means_before", "means_after", "settings", "gains"});
  TunedLaw law;
  law.name = given.key;
  law.settings = settings_of(section, "settings", file);
  law.gains = settings_of(section, "gains", file);
  law.conditions = list_of<std::string>(section, "conditions", "a list of names");
  law.version = section.text("version", "");
  law.seeds = read_seeds(section, file);
  law.evaluations = static_cast<std::size_t>(section.whole("evaluations", 1, 1));
  law.found = list_of<double>(section, "found", "a list of numbers");
  law.before = section.number("before", -kLargest, kLargest, 0.0);
  law.after = section.number("after", -kLargest, kLargest, 0.0);
  law.means_before = list_of<double>(section, "means_before", "a list of numbers");
  law.means_after = list_of<double>(section, "means_after", "a list of numbers");
  return law;
}

}  // namespace

Gains read_gains(const std::string& file) {
  const toml::table table = read_toml(file, "the file of gains");
  const Section section(table, "", file, {"command", "objective", "law"});
  Gains gains;
  gains.file = file;
  gains.command = section.text("command", "");
  gains.objective = section.text("objective", "");
  const toml::table* laws = section.table("law");
  if (laws == nullptr || laws->empty()) section.refuse("law", "given: [law.\"NAME\"] for each");
  for (const PlacedNode& given : entries(*laws, file)) gains.laws.push_back(read_law(given, file));
  return gains;
}

std::string to_toml(const Gains& gains) {
  const auto text = [](const std::string& value) { return to_toml(ScenarioValue(value)); };
  std::string out = fmt::format(
      "# Gains by `tether tune` (docs/howto/experiments.md). Not to be edited: made by the "
      "command.\n"
      "command = {}\nobjective = {}\n",
      text(gains.command), text(gains.objective));
  for (const TunedLaw& law : gains.laws) {
    const std::string name = text(law.name);
    out += fmt::format(
        "\n[law.{}]\nversion = {}\nconditions = {}\nseeds = [{}]\nevaluations = {}\nfound = {}\n",
        name, text(law.version), to_toml(ScenarioValue(law.conditions)), fmt::join(law.seeds, ", "),
        law.evaluations, to_toml(ScenarioValue(law.found)));
    out += fmt::format(
        "before = {}\nafter = {}\nmeans_before = {}\nmeans_after = {}\n[law.{}.settings]\n",
        law.before, law.after, to_toml(ScenarioValue(law.means_before)),
        to_toml(ScenarioValue(law.means_after)), name);
    for (const auto& [key, value] : law.settings) out += fmt::format("{} = {}\n", key, value);
    out += fmt::format("[law.{}.gains]\n", name);
    for (const auto& [key, value] : law.gains) out += fmt::format("{} = {}\n", key, value);
  }
  return out;
}

const TunedLaw* Gains::find(const std::string& law) const {
  const auto is_it = [&law](const TunedLaw& one) { return one.name == law; };
  const auto found = std::find_if(laws.begin(), laws.end(), is_it);
  return found == laws.end() ? nullptr : &*found;
}

std::vector<PlacedSetting> expanded(const PlacedSetting& given, const std::optional<Gains>& gains) {
  if (given.setting.key != "tuned") return {given};
  const std::string name = given.setting.plain();
  if (!gains) {
    throw UsageError(fmt::format("{}: tuned = \"{}\" needs a file of gains: gains = \"FILE\"",
                                 given.place, name));
  }
  std::vector<std::string> names;
  for (const TunedLaw& law : gains->laws) {
    names.push_back(law.name);
    if (law.name != name) continue;
    std::vector<PlacedSetting> meant;
    for (const auto* settings : {&law.settings, &law.gains}) {
      for (const KeyValue& setting : *settings) {
        meant.push_back(
            {setting, fmt::format("{} (law \"{}\" of {})", given.place, name, gains->file)});
      }
    }
    return meant;
  }
  throw UsageError(fmt::format("{}: tuned = \"{}\" must be a law of {}: \"{}\"", given.place, name,
                               gains->file, fmt::join(names, "\", \"")));
}

void check_disjoint(const Gains& gains, const Experiment& experiment, const std::string& file) {
  std::set<std::uint64_t> trained;
  for (const TunedLaw& law : gains.laws) trained.insert(law.seeds.begin(), law.seeds.end());
  const std::size_t arms = experiment.common_random_numbers ? 1 : experiment.arms.size();
  for (std::size_t arm = 0; arm < arms; ++arm) {
    for (std::size_t n = 0; n < experiment.seeds.size(); ++n) {
      if (!trained.contains(experiment.seed(arm, n))) continue;
      throw UsageError(fmt::format(
          "{}: seeds: {} is one of those that {} was tuned with ({}); evaluate with others", file,
          experiment.seed(arm, n), gains.file, seeds_text({trained.begin(), trained.end()})));
    }
  }
}

}  // namespace tether
