#include "common/scenario/loader.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/nearest_name.hpp"
#include "common/base/text.hpp"
#include "common/base/toml_reader.hpp"

namespace tether {
namespace {

std::string last_part(const std::string& key) { return key.substr(key.rfind('.') + 1); }

/// The section whose named tables `key` is of ("channel.links.sat.prr"); null if none.
const NamedTables* named_tables(const ScenarioSchema& schema, const std::string& key) {
  for (const ScenarioSection& section : schema.sections()) {
    if (section.named && key.starts_with(section.named->prefix)) return &*section.named;
  }
  return nullptr;
}

/// "sat" for "channel.links.sat.prr" and "channel.links.sat".
std::string table_name(const NamedTables& tables, const std::string& key) {
  const auto begin = tables.prefix.size();
  return key.substr(begin, key.find('.', begin) - begin);
}

/// Keys that may be meant by a misspelt one, also those that stand for several, such as
/// "channel.prr".
std::vector<std::string> names_beside(const ScenarioSchema& schema,
                                      const std::vector<ScenarioKey>& keys, bool short_forms) {
  std::vector<std::string> names, shorter;
  for (const ScenarioKey& key : keys) {
    names.push_back(key.name);
    if (!short_forms) continue;
    for (const ScenarioSection& section : schema.sections()) {
      if (!section.short_form) continue;
      if (std::string name = section.short_form(key.name); !name.empty()) shorter.push_back(name);
    }
  }
  names.insert(names.end(), shorter.begin(), shorter.end());
  return names;
}

std::optional<NumberList> to_numbers(const toml::array& array) {
  NumberList numbers;
  for (const toml::node& entry : array) {
    const auto number = entry.value<double>();
    if (!number || !entry.is_number()) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::optional<TextList> to_texts(const toml::array& array) {
  TextList texts;
  for (const toml::node& entry : array) {
    const auto* text = entry.as_string();
    if (text == nullptr) return std::nullopt;
    texts.push_back(text->get());
  }
  return texts;
}

std::optional<ScenarioValue> to_lists(const toml::array& array) {
  if (const auto numbers = to_numbers(array)) return *numbers;
  if (const auto texts = to_texts(array)) return *texts;
  NumberRows rows;
  for (const toml::node& entry : array) {
    const auto* row = entry.as_array();
    const auto numbers = row == nullptr ? std::nullopt : to_numbers(*row);
    if (!numbers) return std::nullopt;
    rows.push_back(*numbers);
  }
  return rows;
}

std::optional<std::vector<TableList::Table>> to_tables(const toml::node& node) {
  const auto* list = node.as_array();
  if (list == nullptr) return std::nullopt;
  std::vector<TableList::Table> tables;
  for (const toml::node& entry : *list) {
    const auto* table = entry.as_table();
    if (table == nullptr) return std::nullopt;
    TableList::Table& out = tables.emplace_back();
    for (const auto& [name, inner] : *table) {
      auto value = to_value(inner);
      if (!value) return std::nullopt;
      out.emplace(name.str(), std::move(*value));
    }
  }
  return tables;
}

toml::table parse_value(const std::string& value, const std::string& place) {
  try {
    if (value.find('\n') == std::string::npos) return toml::parse("value = " + value);
    throw UsageError(fmt::format("{}: the value must be one line", place));
  } catch (const toml::parse_error&) {
    // Numbers may be written as elsewhere than in TOML: .49 for 0.49.
    double number = 0.0;
    const auto [end, failed] = std::from_chars(value.data(), value.data() + value.size(), number);
    if (failed == std::errc{} && end == value.data() + value.size()) {
      return toml::table{{"value", number}};
    }
    // Quotes around strings may be left out: --set controller.law=pid.
    if (value.empty() || value.find_first_of("\"'\n[]{}") != std::string::npos) {
      throw UsageError(fmt::format("{}: cannot read the value", place));
    }
    return toml::table{{"value", value}};
  }
}

}  // namespace

std::optional<ScenarioValue> to_value(const toml::node& node) {
  if (const auto* v = node.as_boolean()) return v->get();
  if (const auto* v = node.as_integer()) return v->get();
  if (const auto* v = node.as_floating_point()) return v->get();
  if (const auto* v = node.as_string()) return v->get();
  if (const auto* v = node.as_array()) return to_lists(*v);
  return std::nullopt;
}

/// The keys among which this one is to be looked up.
const std::vector<ScenarioKey>& ScenarioLoader::keys_beside(const std::string& key) {
  const ScenarioSchema& schema = scenario_.schema();
  const NamedTables* tables = named_tables(schema, key);
  const std::string name = tables == nullptr ? "" : table_name(*tables, key);
  if (name.empty()) return schema.keys();
  auto& keys = named_keys_[tables->prefix + name];
  if (keys.empty()) keys = tables->keys(name);
  return keys;
}

const ScenarioKey* ScenarioLoader::find_key(const std::string& key) {
  const auto& keys = keys_beside(key);
  const auto found = std::find_if(keys.begin(), keys.end(),
                                  [&key](const ScenarioKey& k) { return k.name == key; });
  return found == keys.end() ? nullptr : &*found;
}

void ScenarioLoader::refuse_unknown(const std::string& place, const std::string& given,
                                    std::string_view prefix, bool short_forms) {
  const std::string key = printable(given, kLongestValueShown);
  if (const NamedTables* tables = named_tables(scenario_.schema(), given); tables != nullptr) {
    const auto dot = given.find('.', tables->prefix.size());
    const std::string why =
        dot == std::string::npos || !tables->why_not ? "" : tables->why_not(given.substr(dot + 1));
    if (!why.empty()) throw UsageError(fmt::format("{}: {} is not allowed: {}", place, key, why));
  }
  const std::vector<std::string> names =
      names_beside(scenario_.schema(), keys_beside(key), short_forms);
  const std::string& nearest = nearest_name(names, key);
  const auto same_name = std::find_if(names.begin(), names.end(), [&key](const auto& name) {
    return last_part(name) == last_part(key);
  });
  const std::string& hint =
      edit_distance(nearest, key) > 3 && same_name != names.end() ? *same_name : nearest;
  const auto as_given = [prefix](std::string_view name) {
    return name.starts_with(prefix) ? name.substr(prefix.size()) : name;
  };
  throw UsageError(fmt::format(
      "{}: unknown key \"{}\"{} (did you mean \"{}\"? `tether run --keys` lists all keys)", place,
      as_given(key),
      prefix.empty() ? "" : fmt::format(" in [{}]", prefix.substr(0, prefix.size() - 1)),
      as_given(hint)));
}

void ScenarioLoader::apply_table(const toml::table& table, const std::string& prefix,
                                 const std::string& file) {
  for (const auto& [name, node] : table) {
    const std::string key = prefix + std::string(name.str());
    const std::string place = fmt::format("{}:{}", file, node.source().begin.line);
    if (const auto* inner = node.as_table()) {
      const auto& keys = keys_beside(key);
      const NamedTables* tables = named_tables(scenario_.schema(), key + ".");
      // A misspelt section with keys is refused at its first key.
      if (inner->empty() && (tables == nullptr || key + "." != tables->prefix) &&
          std::none_of(keys.begin(), keys.end(),
                       [&key](const ScenarioKey& k) { return k.name.starts_with(key + "."); })) {
        refuse_unknown(place, key);
      }
      make_table(key, place);
      apply_table(*inner, key + ".", file);
    } else if (!apply_list(key, node, place)) {
      apply(key, node, place);
    }
  }
}

void ScenarioLoader::apply_override(const std::string& text, const std::string& place,
                                    std::string_view prefix) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw UsageError(fmt::format("{}: expected KEY=VALUE", place));
  }
  const std::string key =
      std::string(prefix) + std::string(trimmed(std::string_view(text).substr(0, equals)));
  const toml::table parsed = parse_value(std::string(trimmed(text.substr(equals + 1))), place);
  if (apply_list(key, *parsed.get("value"), place)) return;
  for (const std::string& target : scenario_.schema().keys_meant_by(key)) {
    if (find_key(target) == nullptr) refuse_unknown(place, key, prefix, true);
    apply(target, *parsed.get("value"), place);
  }
}

/// "sensor.jumps_per_min is 0"; "" if what `key` says more of is on, or if this level says that it
/// is off.
std::string ScenarioLoader::why_switched_off(const std::string& key) const {
  const SwitchedKey* off = scenario_.schema().switched_off(scenario_, key);
  if (off == nullptr || std::any_of(off->switches.begin(), off->switches.end(),
                                    [&](const auto& name) { return given_.contains(name); })) {
    return "";
  }
  const bool is_zero = off->off == ScenarioValue(0.0);
  return fmt::format("{} {} {}", fmt::join(off->switches, " and "),
                     off->switches.size() > 1 ? "are" : "is", is_zero ? "0" : to_toml(off->off));
}

std::string ScenarioLoader::why_no_effect(const std::string& key) const {
  const std::string why = scenario_.schema().why_no_effect(scenario_, key);
  return why.empty() ? why_switched_off(key) : why;
}

/// Refuses keys that have no effect: with one forgotten line, a bad network would otherwise become
/// a perfect one without notice.
void ScenarioLoader::end_level(const std::string& source, const std::filesystem::path& folder) {
  const auto check = [&](const std::string& key) {
    const std::string why = why_no_effect(key);
    if (!why.empty()) {
      throw UsageError(fmt::format("{}: {} has no effect: {}", source, key, why));
    }
  };
  for (const ScenarioKey& key : scenario_.schema().keys()) {
    if (given_.contains(key.name)) check(key.name);
  }
  for (const std::string& key : given_) {
    if (named_tables(scenario_.schema(), key) != nullptr) check(key);
  }
  for (const std::string& key : given_) {
    const ScenarioKey* named = find_key(key);
    if (named == nullptr || !named->file) continue;
    std::string& file = named->file(scenario_);
    file = (folder / file).lexically_normal().string();
  }
  const ScenarioLevel level{
      source, folder, given_,
      [this, &source](const std::string& key, double value, const std::string& from) {
        set_derived(key, value, from, source);
      }};
  for (const ScenarioSection& section : scenario_.schema().sections()) {
    if (section.end_level) section.end_level(scenario_, level);
  }
  given_at_any_.merge(given_);
  given_.clear();
}

Scenario ScenarioLoader::completed(const std::string& file) const {
  Scenario scenario = scenario_;
  for (const ScenarioSection& section : scenario.schema().sections()) {
    if (section.complete) section.complete(scenario, given_at_any_, file);
  }
  return scenario;
}

Scenario ScenarioLoader::with(const ScenarioValues& values, const std::string& source) const {
  ScenarioLoader one(scenario_);
  one.given_at_any_ = given_at_any_;
  for (const auto& [key, value] : values) {
    one.find_key(key)->set(one.scenario_, value);
    one.given_.insert(key);
  }
  one.end_level(source, {});
  return one.completed(source);
}

Scenario ScenarioLoader::finish(const std::string& file) const {
  Scenario scenario = completed(file);
  const auto& sections = scenario.schema().sections();
  const ScenarioWith with_values = [this](const ScenarioValues& values, const std::string& source) {
    return with(values, source);
  };
  for (const ScenarioSection& section : sections) {
    if (section.vary) section.vary(scenario, with_values, file);
  }
  for (const ScenarioSection& section : sections) {
    if (section.check) section.check(scenario, file);
  }
  return scenario;
}

/// Makes the named table that `key` is in, or that `key` itself names, if there is none yet.
void ScenarioLoader::make_table(const std::string& key, const std::string& place) {
  const NamedTables* tables = named_tables(scenario_.schema(), key);
  if (tables != nullptr) tables->make(scenario_, table_name(*tables, key), place);
}

void ScenarioLoader::apply(const std::string& key, const toml::node& node,
                           const std::string& place) {
  const ScenarioKey* found = find_key(key);
  if (found == nullptr) refuse_unknown(place, key);
  make_table(key, place);
  const auto value = to_value(node);
  if (!value || !found->set(scenario_, *value)) {
    throw UsageError(fmt::format("{}: {} = {} is not allowed: must be {} ({})", place, key,
                                 printable(toml_text(node), kLongestValueShown), found->allowed,
                                 found->meaning));
  }
  given_.insert(key);
}

/// False if `key` is not that of a list of tables.
bool ScenarioLoader::apply_list(const std::string& key, const toml::node& node,
                                const std::string& place) {
  for (const ScenarioSection& section : scenario_.schema().sections()) {
    if (!section.list || section.list->key != key) continue;
    const auto tables = to_tables(node);
    if (!tables || !section.list->read(scenario_, *tables, place)) {
      throw UsageError(fmt::format("{}: {}", place, section.list->allowed));
    }
    given_.insert(key);
    return true;
  }
  return false;
}

void ScenarioLoader::set_derived(const std::string& key, double value, const std::string& from,
                                 const std::string& file) {
  const ScenarioKey* found = find_key(key);
  if (!found->set(scenario_, value)) {
    throw UsageError(fmt::format("{}: {} give {} = {}, which is not allowed: must be {}", file,
                                 from, key, value, found->allowed));
  }
}

}  // namespace tether
