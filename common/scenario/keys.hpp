#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

using NumberList = std::vector<double>;
using NumberRows = std::vector<NumberList>;

/// A value of a scenario key, as TOML has it.
using ScenarioValue = std::variant<bool, std::int64_t, double, std::string, NumberList, NumberRows>;

/// One key of the scenario file: the single place that knows its name, type, range and meaning.
struct ScenarioKey {
  std::string name;     ///< dotted, such as "channel.uplink.prr"
  std::string allowed;  ///< for messages: "a number in [0, 1]"
  std::string meaning;  ///< one line, with unit
  /// nullopt: not set, left out of the resolved scenario.
  std::function<std::optional<ScenarioValue>(const Scenario&)> get;
  /// False if `value` is of the wrong type or out of range; then nothing changes.
  std::function<bool(Scenario&, const ScenarioValue&)> set;
};

/// As TOML has it: the shortest text that reads as the same value.
std::string to_toml(const ScenarioValue& value);

/// All keys but those of links by name, in the order of the resolved scenario file.
const std::vector<ScenarioKey>& scenario_keys();

/// `vehicle.plant is "kinematic"`, or what the drivetrain is, for keys that these ignore; empty for
/// all others.
std::string why_plant_ignores(const Scenario& scenario, const std::string& key);

/// `controller.law is another one` for keys that the chosen law ignores; empty for all others. Such
/// keys are no mistake: one file may have what several laws need.
std::string why_law_ignores(const Scenario& scenario, const std::string& key);

/// The keys of [channel.links.NAME]: those of [channel.uplink], with that prefix.
std::vector<ScenarioKey> named_link_keys(const std::string& name);

}  // namespace tether
