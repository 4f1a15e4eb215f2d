#include "common/base/text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/scenario/key_table.hpp"
#include "common/scenario/section.hpp"

namespace tether {
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
