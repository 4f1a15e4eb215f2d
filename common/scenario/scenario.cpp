#include "common/scenario/scenario.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/input_file.hpp"
#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/base/toml_reader.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/loader.hpp"
#include "common/scenario/section.hpp"

namespace tether {
namespace {

ScenarioLoader start_from_text(const std::string& toml, const std::string& name) {
  ScenarioLoader loader;
  loader.apply_table(parse_toml(toml, name), "", name);
  loader.end_level(name, std::filesystem::path(name).parent_path());
  return loader;
}

Scenario with_overrides(ScenarioLoader loader, const std::string& name,
                        const std::vector<std::string>& overrides) {
  for (const std::string& text : overrides) loader.apply_override(text, "--set " + text);
  loader.end_level("--set", {});
  return loader.finish(name);
}

}  // namespace

Scenario::Scenario() : Scenario(ScenarioSchema::all()) {}

Scenario::Scenario(std::shared_ptr<const ScenarioSchema> schema) : schema_(std::move(schema)) {
  for (const ScenarioSection& section : schema_->sections()) sections_.push_back(section.defaults);
}

ScenarioLoader start_from_file(const std::string& name) {
  const std::string file = input_named(name);
  return start_from_text(read_input(file, "the scenario file", kMostTomlBytes), file);
}

Scenario parse_scenario(const std::string& toml, const std::string& name,
                        const std::vector<std::string>& overrides) {
  return with_overrides(start_from_text(toml, name), name, overrides);
}

Scenario load_scenario(const std::string& name, const std::vector<std::string>& overrides) {
  const std::string file = input_named(name);
  return with_overrides(start_from_file(file), file, overrides);
}

ScenarioSchema::ScenarioSchema(std::vector<ScenarioSection> sections)
    : sections_(std::move(sections)) {
  for (const ScenarioSection& section : sections_) {
    keys_.insert(keys_.end(), section.keys.begin(), section.keys.end());
  }
}

std::shared_ptr<const ScenarioSchema> ScenarioSchema::all() {
  static const auto schema = std::make_shared<const ScenarioSchema>(scenario_sections());
  return schema;
}

std::vector<ScenarioKey> ScenarioSchema::keys_of(const Scenario& scenario) const {
  std::vector<ScenarioKey> keys = keys_;
  for (const ScenarioSection& section : sections_) {
    if (!section.named) continue;
    for (const std::string& name : section.named->names(scenario)) {
      for (ScenarioKey& key : section.named->keys(name)) keys.push_back(std::move(key));
    }
  }
  return keys;
}

std::vector<std::pair<std::string, ScenarioValue>> ScenarioSchema::values_of(
    const Scenario& scenario) const {
  std::vector<std::pair<std::string, ScenarioValue>> values;
  for (const ScenarioKey& key : keys_of(scenario)) {
    auto value = key.get(scenario);
    if (!value || !why_no_effect(scenario, key.name).empty() || left_out(scenario, key)) continue;
    values.emplace_back(key.name, std::move(*value));
  }
  return values;
}

std::string ScenarioSchema::why_no_effect(const Scenario& scenario, const std::string& key) const {
  for (const ScenarioSection& section : sections_) {
    if (!section.why_no_effect) continue;
    if (std::string why = section.why_no_effect(scenario, key); !why.empty()) return why;
  }
  return "";
}

bool ScenarioSchema::left_out(const Scenario& scenario, const ScenarioKey& key) const {
  if (switched_off(scenario, key.name) != nullptr) return true;
  return std::any_of(sections_.begin(), sections_.end(), [&](const ScenarioSection& section) {
    return section.left_out && section.left_out(scenario, key);
  });
}

const SwitchedKey* ScenarioSchema::switched_off(const Scenario& scenario,
                                                const std::string& key) const {
  for (const ScenarioSection& section : sections_) {
    for (const SwitchedKey& switched : section.switched) {
      if (switched.key != key) continue;
      const bool off =
          std::all_of(section.keys.begin(), section.keys.end(), [&](const ScenarioKey& other) {
            return std::find(switched.switches.begin(), switched.switches.end(), other.name) ==
                       switched.switches.end() ||
                   other.get(scenario) == switched.off;
          });
      if (off) return &switched;
    }
  }
  return nullptr;
}

std::vector<std::string> ScenarioSchema::keys_meant_by(const std::string& key) const {
  for (const ScenarioSection& section : sections_) {
    if (!section.stands_for) continue;
    if (auto keys = section.stands_for(key); !keys.empty()) return keys;
  }
  return {key};
}

namespace {

std::string text_of(double value) {
  const std::string text = fmt::format("{}", value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

std::string text_of(std::int64_t value) { return fmt::format("{}", value); }
std::string text_of(bool value) { return value ? "true" : "false"; }

std::string text_of(const std::string& text) { return in_quotes(text); }

template <class Entry>
std::string text_of(const std::vector<Entry>& list) {
  std::string text;
  for (const Entry& entry : list) text += (text.empty() ? "" : ", ") + text_of(entry);
  return "[" + text + "]";
}

/// A table's name, with quotes around parts that need them: fleet.vehicle."3,5".sensor.
std::string header_of(const std::string& name) {
  std::string header;
  for (std::size_t begin = 0; begin <= name.size();) {
    const std::size_t end = std::min(name.find('.', begin), name.size());
    const std::string part = name.substr(begin, end - begin);
    header += (begin == 0 ? "" : ".") + (is_identifier(part) ? part : text_of(part));
    begin = end + 1;
  }
  return header;
}

}  // namespace

std::string to_toml(const ScenarioValue& value) {
  return std::visit([](const auto& v) { return text_of(v); }, value);
}

std::string to_toml(const Scenario& scenario) {
  const ScenarioSchema& schema = scenario.schema();
  // A table may have but one header, wherever its keys stand.
  std::vector<std::pair<std::string, std::string>> tables;
  for (const auto& [key, value] : schema.values_of(scenario)) {
    const auto dot = key.rfind('.');
    const std::string name = key.substr(0, dot);
    auto table = std::find_if(tables.begin(), tables.end(),
                              [&name](const auto& other) { return other.first == name; });
    if (table == tables.end()) table = tables.insert(tables.end(), {name, ""});
    table->second += fmt::format("{} = {}\n", key.substr(dot + 1), to_toml(value));
  }
  std::string text;
  for (const auto& [name, keys] : tables) {
    text += fmt::format("{}[{}]\n{}", text.empty() ? "" : "\n", header_of(name), keys);
  }
  for (const ScenarioSection& part : schema.sections()) {
    if (part.list) text += part.list->to_toml(scenario);
  }
  return text;
}

std::string describe_scenario_keys() {
  const Scenario defaults;
  std::string text;
  for (const ScenarioKey& key : defaults.schema().keys()) {
    const auto value = key.get(defaults);
    text += fmt::format("{} = {}\n    {}; {}\n", key.name, value ? to_toml(*value) : "(not set)",
                        key.meaning, key.allowed);
  }
  for (const ScenarioSection& section : defaults.schema().sections()) text += section.help;
  return text;
}

}  // namespace tether
