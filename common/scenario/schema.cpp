#include <algorithm>
#include <utility>

#include "common/scenario/section.hpp"

namespace tether {

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

}  // namespace tether
