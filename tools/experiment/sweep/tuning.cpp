#include "tools/experiment/sweep/tuning.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <variant>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/base/toml_reader.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/loader.hpp"
#include "tools/experiment/sweep/section.hpp"
#include "tools/experiment/sweep/seeds.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

constexpr double kLargest = 1e300;
constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

/// Default effort of each law without its own.
struct Effort {
  SearchBudget budget;
  std::size_t searches = 1;
  /// Starts at the centre of the bounds, not at the scenario's values.
  bool starts_at_centre = false;
  bool is_quick = false;
};

std::vector<PlacedSetting> as_they_are(const PlacedSetting& given) { return {given}; }

const toml::table& table_of(const PlacedNode& given, const std::string& what) {
  const toml::table* table = given.node->as_table();
  if (table != nullptr) return *table;
  throw UsageError(fmt::format("{}: {} must be a table", given.place, what));
}

/// The tables that a table of the file has, in their order; at least one.
std::vector<PlacedNode> named_tables(const Section& section, const std::string& key,
                                     const std::string& file) {
  const toml::table* table = section.table(key);
  if (table == nullptr || table->empty()) {
    section.refuse(key, fmt::format("given: [{}.\"NAME\"] for each", key));
  }
  return entries(*table, file);
}

/// The number of a text or truth value among `choices`; nullopt if it is not one of them.
std::optional<double> place_of(const std::string& text, const std::vector<std::string>& choices) {
  const auto is_it = [&text](const std::string& choice) {
    return KeyValue{"", choice}.plain() == KeyValue{"", text}.plain();  // in either quotes
  };
  const auto found = std::find_if(choices.begin(), choices.end(), is_it);
  if (found == choices.end()) return std::nullopt;
  return static_cast<double>(found - choices.begin());
}

/// controller.trigger = { choices = ["event", "timer"] }
TunedKey read_choices(const PlacedNode& given, const Section& section) {
  TunedKey key{given.key, 0.0, 0.0, false, {}, {}, given.place};
  const auto read = [&section](const char* name, const auto& use) {
    const toml::node* node = section.get(name);
    const toml::array* list = node == nullptr ? nullptr : node->as_array();
    return list != nullptr && !list->empty() &&
           std::all_of(list->begin(), list->end(), [&use](const toml::node& entry) {
             return (entry.is_string() || entry.is_boolean()) && use(value_text(entry));
           });
  };
  const bool is_good = read("choices", [&key](const std::string& text) {
    key.choices.push_back(text);
    return std::count(key.choices.begin(), key.choices.end(), text) == 1;
  });
  if (!is_good || key.choices.size() < 2) {
    section.refuse("choices", "a list of at least two different texts or truth values");
  }
  key.to = static_cast<double>(key.choices.size() - 1);
  const bool is_known = read("known", [&key](const std::string& text) {
    const std::optional<double> place = place_of(text, key.choices);
    key.known.push_back(place.value_or(0.0));
    return place.has_value();
  });
  if (section.get("known") != nullptr && !is_known) section.refuse("known", "a list of choices");
  return key;
}

TunedKey read_key(const PlacedNode& given, const std::string& file) {
  const std::string what = fmt::format("{} = {{ from, to, scale, known }}", given.key);
  const toml::table& table = table_of(given, what);
  if (table.contains("choices")) {
    return read_choices(given, Section(table, given.key + ".", file, {"choices", "known"}));
  }
  const Section section(table, given.key + ".", file, {"from", "to", "scale", "known"});
  for (const char* bound : {"from", "to"}) {
    if (section.get(bound) == nullptr) section.refuse(bound, "given");
  }
  TunedKey key{given.key,  section.number("from", -kLargest, kLargest, 0.0), 0.0, false, {}, {},
               given.place};
  key.to = section.number("to", -kLargest, kLargest, 0.0);
  if (!(key.from < key.to)) {
    throw UsageError(fmt::format("{}: {} = {{ from = {}, to = {} }}: from must be below to",
                                 given.place, given.key, key.from, key.to));
  }
  const std::string scale = section.text("scale", "linear");
  if (scale != "linear" && scale != "log") section.refuse("scale", "\"linear\" or \"log\"");
  key.is_log = scale == "log";
  if (key.is_log && key.from <= 0.0) section.refuse("from", "positive where scale is \"log\"");
  if (const toml::node* known = section.get("known")) {
    const toml::array* list = known->as_array();
    for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
      const std::optional<double> value = (*list)[i].value<double>();
      if (value && *value >= key.from && *value <= key.to) key.known.push_back(*value);
    }
    if (list == nullptr || list->empty() || key.known.size() != list->size()) {
      section.refuse("known", "a list of numbers within the bounds");
    }
  }
  return key;
}

using Bounds = std::map<std::string, std::vector<TunedKey>>;

Bounds read_bounds(const Section& section, const std::string& file) {
  Bounds bounds;
  for (const PlacedNode& set : named_tables(section, "bounds", file)) {
    std::vector<TunedKey>& keys = bounds[set.key];
    for (const PlacedNode& key : flatten(table_of(set, "bounds." + set.key), file)) {
      keys.push_back(read_key(key, file));
    }
    if (keys.empty()) {
      throw UsageError(fmt::format("{}: bounds.{} has no key", set.place, set.key));
    }
    for (const TunedKey& key : keys) {
      if (key.known.size() == keys.front().known.size()) continue;
      throw UsageError(fmt::format("{}: {}.known must have as many values as {}.known, or neither",
                                   key.place, key.key, keys.front().key));
    }
  }
  return bounds;
}

/// The numbers of the conditions that a law names; of all if it names none.
std::vector<std::size_t> conditions_of(const PlacedNode& law, const toml::node* names,
                                       const Tuning& tuning) {
  std::vector<std::size_t> numbers(tuning.conditions.size());
  std::iota(numbers.begin(), numbers.end(), 0);
  if (names == nullptr) return numbers;
  std::vector<std::string> allowed;
  for (const TuningCondition& condition : tuning.conditions) allowed.push_back(condition.name);
  std::vector<std::size_t> chosen;
  const toml::array* list = names->as_array();
  for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
    const auto name = (*list)[i].value<std::string>().value_or("");
    const auto found = std::find(allowed.begin(), allowed.end(), name);
    if (found == allowed.end()) {
      chosen.clear();
      break;
    }
    chosen.push_back(static_cast<std::size_t>(found - allowed.begin()));
  }
  if (!chosen.empty()) return chosen;
  throw UsageError(fmt::format("{}: law.\"{}\".conditions must be a list of \"{}\"", law.place,
                               law.key, fmt::join(allowed, "\", \"")));
}

/// Keys of a law's table that are not scenario keys.
const std::set<std::string> kOfTheLaw{"bounds", "conditions", "evaluations", "first_seeds"};

/// A law's own effort, where it has one, in place of the tuning's.
void read_own_effort(const PlacedNode& given, const toml::table& table, const Effort& effort,
                     const Tuning& tuning, TuningLaw& law) {
  std::set<std::string> known = kOfTheLaw;  // the others are scenario keys
  for (const auto& [key, value] : table) known.emplace(key.str());
  const Section section(table, fmt::format("law.\"{}\".", given.key), tuning.file, known);
  const auto most = [&](const char* key, std::int64_t least, std::size_t all) {
    const auto own_number = section.whole(key, least, static_cast<std::int64_t>(all));
    return std::min(static_cast<std::size_t>(own_number), effort.is_quick ? all : kNoLimit);
  };
  law.searches = effort.searches;
  law.budget.evaluations = most("evaluations", 2, effort.budget.evaluations);
  law.budget.rounds = std::min(effort.budget.rounds, law.budget.evaluations / 2);
  law.seeds = tuning.seeds;
  law.seeds.resize(std::min(law.seeds.size(), most("first_seeds", 1, law.seeds.size())));
}

TuningLaw read_law(const PlacedNode& given, const Bounds& bounds, const Effort& effort,
                   const Tuning& tuning) {
  const toml::table& table = table_of(given, fmt::format("law.\"{}\"", given.key));
  TuningLaw law;
  law.name = given.key;
  law.conditions = conditions_of(given, table.get("conditions"), tuning);
  const auto set = bounds.find(table["bounds"].value<std::string>().value_or(""));
  if (set == bounds.end()) {
    std::vector<std::string> names;
    for (const auto& [name, keys] : bounds) names.push_back(name);
    throw UsageError(fmt::format("{}: law.\"{}\".bounds must be given, one of \"{}\"", given.place,
                                 given.key, fmt::join(names, "\", \"")));
  }
  law.keys = set->second;
  for (const PlacedSetting& setting : settings_in(table, tuning.file, as_they_are)) {
    if (!kOfTheLaw.contains(setting.setting.key)) law.settings.push_back(setting);
  }
  read_own_effort(given, table, effort, tuning, law);
  return law;
}

std::optional<ScenarioKey> find_key(const Scenario& scenario, const TunedKey& key) {
  const std::string name = ScenarioSchema::all()->keys_meant_by(key.key).front();
  for (const ScenarioKey& one : scenario.schema().keys_of(scenario)) {
    if (one.name == name) return one;
  }
  return std::nullopt;
}

/// Value of a key in a scenario.
double value_in(const Scenario& scenario, const TunedKey& key) {
  const auto found = find_key(scenario, key);
  const auto value = found ? found->get(scenario) : std::nullopt;
  if (value && key.choices.empty() && std::holds_alternative<double>(*value)) {
    return std::get<double>(*value);
  }
  if (value && !key.choices.empty()) {
    if (const auto place = place_of(to_toml(*value), key.choices)) return *place;
    throw UsageError(fmt::format("{}: {}.choices must have {}, from which tuning starts", key.place,
                                 key.key, to_toml(*value)));
  }
  throw UsageError(fmt::format(
      "{}: {} must be a scenario key whose value is a number, and set: tuning starts from it",
      key.place, key.key));
}

/// `start`, and the same with each other choice of each key that has choices.
std::vector<std::vector<double>> with_each_choice(const TuningLaw& law,
                                                  const std::vector<double>& start) {
  std::vector<std::vector<double>> all{start};
  for (std::size_t i = 0; i < law.keys.size(); ++i) {
    for (std::size_t choice = 0; choice < law.keys[i].choices.size(); ++choice) {
      all.push_back(start);
      all.back()[i] = static_cast<double>(choice);
    }
  }
  return all;
}

/// Refuses key `i` if it has no effect, whatever the others' choices, and bounds of it that the
/// scenario refuses.
void refuse_without_effect(const Tuning& tuning, const TuningLaw& law,
                           const std::vector<double>& start, std::size_t i) {
  const TunedKey& key = law.keys[i];
  bool has_effect = false;
  for (std::vector<double> values : with_each_choice(law, start)) {
    for (const double bound : {key.from, key.to}) {
      values[i] = bound;
      const Scenario scenario = tuning.scenario_of(law, law.conditions.front(), values);
      const ScenarioKey found = find_key(scenario, key).value();
      has_effect |= scenario.schema().why_no_effect(scenario, found.name).empty() &&
                    !scenario.schema().left_out(scenario, found);
    }
  }
  if (has_effect) return;
  throw UsageError(fmt::format("{}: {} has no effect on law \"{}\"", key.place, key.key, law.name));
}

/// Fills in what the law's first search begins with, and refuses bounds that the scenario refuses.
void find_given(const Tuning& tuning, const Effort& effort, TuningLaw& law) {
  std::vector<double> start;
  for (const std::size_t condition : law.conditions) {
    const Scenario scenario = tuning.scenario_of(law, condition, {});
    if (!start.empty()) continue;  // the others are to be loaded only
    for (const TunedKey& key : law.keys) start.push_back(value_in(scenario, key));
  }
  for (std::size_t i = 0; i < law.keys.size(); ++i) refuse_without_effect(tuning, law, start, i);
  const SearchPoint centre = sequence_point(law.keys.size(), 0);
  for (std::size_t i = 0; effort.starts_at_centre && i < law.keys.size(); ++i) {
    start[i] = law.keys[i].at(centre[i]);
  }
  law.given = {start};
  for (std::size_t n = 0; n < law.keys.front().known.size(); ++n) {
    law.given.emplace_back();
    for (const TunedKey& key : law.keys) law.given.back().push_back(key.known[n]);
  }
  const std::size_t first = round_sizes(law.budget).front();
  if (law.given.size() > first) law.given.resize(first);  // with --quick, perhaps
}

std::vector<Aim> read_aims(const Section& section) {
  const toml::node* node = section.get("aims");
  if (node == nullptr) return {Aim::error};
  std::vector<Aim> aims;
  const toml::array* list = node->as_array();
  for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
    const std::string name = (*list)[i].value<std::string>().value_or("");
    const Aim aim = name == "survival" ? Aim::survival : Aim::error;
    const bool is_new = std::find(aims.begin(), aims.end(), aim) == aims.end();
    if ((name == "error" || name == "survival") && is_new) aims.push_back(aim);
  }
  if (list == nullptr || list->empty() || aims.size() != list->size()) {
    section.refuse("aims", "a list of \"error\" and \"survival\", or one of them");
  }
  return aims;
}

std::vector<std::uint64_t> read_front_seeds(const Section& section, const std::string& file,
                                            const Tuning& tuning) {
  std::vector<std::uint64_t> seeds = read_seeds(section, file);
  for (const std::uint64_t seed : seeds) {
    if (std::count(tuning.seeds.begin(), tuning.seeds.end(), seed) == 0) continue;
    section.refuse("seeds", fmt::format("others than the tuning's, of which {} is one", seed));
  }
  return seeds;
}

void apply(const PlacedSetting& given, ScenarioLoader& loader) {
  if (given.setting.key == "run.seed") {
    throw UsageError(fmt::format("{}: run.seed is every run's own: use seeds", given.place));
  }
  loader.apply_override(fmt::format("{}={}", given.setting.key, given.setting.value), given.place);
}

Effort read_effort(const Section& section, bool quick, Tuning& tuning) {
  Effort effort;
  effort.is_quick = quick;
  const std::int64_t all = section.whole("evaluations", 2, 120);
  const std::int64_t few = std::min(section.whole("quick_evaluations", 2, all), all);
  effort.budget.evaluations = static_cast<std::size_t>(quick ? few : all);
  effort.budget.rounds = static_cast<std::size_t>(section.whole("rounds", 1, 9));
  effort.budget.rounds = std::min(effort.budget.rounds, effort.budget.evaluations / 2);
  const std::int64_t searches = section.whole("searches", 1, 1);
  effort.searches = quick ? 1 : static_cast<std::size_t>(searches);
  const std::string start = section.text("start", "scenario");
  if (start != "scenario" && start != "centre") {
    section.refuse("start", "\"scenario\" or \"centre\"");
  }
  effort.starts_at_centre = start == "centre";
  const auto seeds = static_cast<std::int64_t>(tuning.seeds.size());
  const std::int64_t few_seeds = std::min(section.whole("quick_seeds", 1, seeds), seeds);
  if (quick) {
    tuning.seeds.resize(static_cast<std::size_t>(few_seeds));
    const std::size_t few_of_front = static_cast<std::size_t>(few_seeds);
    tuning.front_seeds.resize(std::min(tuning.front_seeds.size(), few_of_front));
  }
  return effort;
}

}  // namespace

double TunedKey::at(double coordinate) const {
  if (!choices.empty()) {
    const auto n = static_cast<double>(choices.size());
    return std::clamp(std::floor(coordinate * n), 0.0, n - 1.0);
  }
  const double value =
      is_log ? from * std::pow(to / from, coordinate) : from + coordinate * (to - from);
  const double rounded = to_number<double>(fmt::format("{:.3g}", value)).value();
  return std::clamp(rounded, from, to);
}

double TunedKey::coordinate_of(double value) const {
  if (!choices.empty()) return (value + 0.5) / static_cast<double>(choices.size());
  const double inside = std::clamp(value, from, to);
  return is_log ? std::log(inside / from) / std::log(to / from) : (inside - from) / (to - from);
}

std::string TunedKey::text(double value) const {
  return choices.empty() ? number_text(value) : choices[static_cast<std::size_t>(value)];
}

std::string number_text(double value) { return to_toml(ScenarioValue(value)); }

std::string Tuning::objective(Aim aim) const {
  const std::string mean =
      fmt::format("{} mean over the conditions of the mean of {}{} over the seeds",
                  rule.is_geometric ? "geometric" : "arithmetic", metric,
                  std::isfinite(rule.most) ? fmt::format(", {} at most,", rule.most) : "");
  return aim == Aim::error ? mean : "lost vehicles + e/(1 + e), e of the others: " + mean;
}

TuningLaw::Chosen TuningLaw::chosen(const ScenarioLoader& before,
                                    const std::vector<double>& values) const {
  Chosen all{settings, {}};
  for (std::size_t i = 0; i < values.size(); ++i) {
    all.gains.push_back({{keys[i].key, keys[i].text(values[i])}, keys[i].place});
  }
  const bool has_choices = std::any_of(keys.begin(), keys.end(),
                                       [](const TunedKey& key) { return !key.choices.empty(); });
  if (!has_choices) return all;
  ScenarioLoader loader = before;
  for (const auto* given : {&all.settings, &all.gains}) {
    for (const PlacedSetting& setting : *given) apply(setting, loader);
  }
  for (auto* given : {&all.settings, &all.gains}) {
    std::erase_if(*given, [&loader](const PlacedSetting& setting) {
      const auto meant = ScenarioSchema::all()->keys_meant_by(setting.setting.key);
      return !loader.why_no_effect(meant.front()).empty();
    });
  }
  return all;
}

TuningLaw::Chosen Tuning::chosen(const TuningLaw& law, const std::vector<double>& values) const {
  ScenarioLoader loader = start_from_file(scenario_file);
  for (const PlacedSetting& given : set) apply(given, loader);
  return law.chosen(loader, values);
}

Scenario Tuning::scenario_of(const TuningLaw& law, std::size_t condition,
                             const std::vector<double>& values) const {
  ScenarioLoader loader = start_from_file(scenario_file);
  for (const PlacedSetting& given : set) apply(given, loader);
  const TuningLaw::Chosen chosen = law.chosen(loader, values);
  for (const PlacedSetting& given : chosen.settings) apply(given, loader);
  for (const PlacedSetting& given : conditions[condition].settings) apply(given, loader);
  for (const PlacedSetting& given : chosen.gains) apply(given, loader);
  loader.end_level(file, fs::path(file).parent_path());
  for (const std::string& text : overrides) loader.apply_override(text, "--set " + text);
  loader.end_level("--set", {});
  return loader.finish(scenario_file);
}

Tuning load_tuning(const std::string& name, const std::vector<std::string>& overrides, bool quick) {
  const std::string file = input_named(name);
  const toml::table table = read_toml(file, "the tuning file");
  const Section section(table, "", file,
                        {"name", "scenario", "seeds", "quick_seeds", "metric", "most", "mean",
                         "evaluations", "quick_evaluations", "rounds", "searches", "start", "set",
                         "condition", "bounds", "law", "aims", "front"});
  Tuning tuning;
  tuning.file = file;
  tuning.overrides = overrides;
  tuning.name = section.text("name", fs::path(file).stem().string());
  if (!is_identifier(tuning.name)) {
    section.refuse("name", "letters, digits, '-' and '_', at most 32");
  }
  const std::string scenario = section.text("scenario", "");
  if (scenario.empty()) section.refuse("scenario", "given: a scenario file");
  tuning.scenario_file = (fs::path(file).parent_path() / scenario).lexically_normal().string();
  tuning.metric = section.metric("metric");
  tuning.rule.most =
      section.number("most", 1e-12, kLargest, std::numeric_limits<double>::infinity());
  const std::string mean = section.text("mean", "geometric");
  if (mean != "geometric" && mean != "arithmetic") {
    section.refuse("mean", "\"geometric\" or \"arithmetic\"");
  }
  tuning.rule.is_geometric = mean == "geometric";
  tuning.aims = read_aims(section);
  tuning.seeds = read_seeds(section, file);
  if (const toml::table* front = section.table("front")) {
    tuning.front_seeds = read_front_seeds(Section(*front, "front.", file, {"seeds"}), file, tuning);
  }
  const Effort effort = read_effort(section, quick, tuning);
  if (const toml::table* set = section.table("set")) {
    tuning.set = settings_in(*set, file, as_they_are);
  }
  for (const PlacedNode& given : named_tables(section, "condition", file)) {
    const toml::table& settings = table_of(given, fmt::format("condition.\"{}\"", given.key));
    tuning.conditions.push_back({given.key, settings_in(settings, file, as_they_are)});
  }
  const Bounds bounds = read_bounds(section, file);
  for (const PlacedNode& given : named_tables(section, "law", file)) {
    tuning.laws.push_back(read_law(given, bounds, effort, tuning));
    if (!tuning.front_seeds.empty() &&
        tuning.laws.back().conditions.size() != tuning.conditions.size()) {
      throw UsageError(fmt::format("{}: law.\"{}\" must have all conditions, because of [front]",
                                   given.place, given.key));
    }
    find_given(tuning, effort, tuning.laws.back());
  }
  return tuning;
}

}  // namespace tether
