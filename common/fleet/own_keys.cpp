#include "common/fleet/own_keys.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

constexpr std::string_view kPrefix = "fleet.vehicle.";
constexpr std::array<std::string_view, 10> kDiffer{
    "vehicle.",        "sensor.",           "path.",  "controller.", "actuator.",
    "channel.uplink.", "channel.downlink.", "lidar.", "localiser.",  "autonomy."};
/// One hall has one physics, and who is on the network is known by its name.
constexpr std::array<std::string_view, 7> kShared{
    "vehicle.name",       "vehicle.plant",   "vehicle.drivetrain",   "controller.external",
    "controller.command", "controller.warm", "controller.patience_s"};

std::optional<int> vehicle_number(std::string_view text) {
  const auto number = to_number<int>(text);
  const bool is_good = number && *number >= 1 && *number <= kMostVehicles && text.front() != '0';
  return is_good ? number : std::nullopt;
}

std::string why_shared(const std::string& key) {
  const auto& schema = *ScenarioSchema::all();
  const auto& keys = schema.keys();
  const bool is_key =
      std::any_of(keys.begin(), keys.end(), [&](const auto& one) { return one.name == key; });
  const bool is_table =
      std::any_of(schema.sections().begin(), schema.sections().end(), [&](const auto& section) {
        return (section.list && section.list->key == key) ||
               (section.named && key.starts_with(section.named->prefix));
      });
  if (!is_key && !is_table) return "";
  return fmt::format(
      "{} is all vehicles'; one of a fleet may differ in keys of vehicle (but for name, plant and "
      "drivetrain), sensor, path, controller (but for external, command, warm and patience_s), "
      "actuator, channel.uplink, "
      "channel.downlink, lidar, localiser and autonomy",
      key);
}

/// A key like the scenario's own, but stored beside it.
ScenarioKey own_key(const ScenarioKey& key, const std::string& table) {
  ScenarioKey own = key;
  own.name = std::string(kPrefix) + table + "." + key.name;
  own.get = [table, name = key.name](const Scenario& scenario) -> std::optional<ScenarioValue> {
    const auto& tables = scenario.get<FleetSettings>().own;
    const auto found = tables.find(table);
    if (found == tables.end()) return std::nullopt;
    const auto value = found->second.find(name);
    return value == found->second.end() ? std::nullopt : std::optional(value->second);
  };
  own.set = [table, name = key.name, set = key.set](Scenario& scenario,
                                                    const ScenarioValue& value) {
    Scenario tried(ScenarioSchema::all());
    if (!set(tried, value)) return false;
    scenario.get<FleetSettings>().own[table][name] = value;
    return true;
  };
  if (!key.file) return own;
  own.file = [table, name = key.name](Scenario& scenario) -> std::string& {
    auto& tables = scenario.get<FleetSettings>().own;
    const auto found = tables.find(table);
    if (found != tables.end() && found->second.contains(name)) {
      return std::get<std::string>(found->second.at(name));
    }
    static thread_local std::string none;
    none.clear();
    return none;
  };
  return own;
}

/// The tables of each vehicle, from number 1 on.
std::vector<std::vector<std::string>> tables_of_vehicles(const FleetSettings& fleet,
                                                         const std::string& file) {
  std::vector<std::vector<std::string>> tables(static_cast<std::size_t>(fleet.count));
  for (const auto& [name, values] : fleet.own) {
    for (const int number : vehicle_numbers(name)) {
      if (fleet.is_one()) {
        throw UsageError(
            fmt::format("{}: {}{} has no effect: fleet.count is 1", file, kPrefix, name));
      }
      if (number > fleet.count) {
        throw UsageError(
            fmt::format("{}: {}{} is not allowed: numbers are 1 to {}, which is fleet.count", file,
                        kPrefix, name, fleet.count));
      }
      tables[static_cast<std::size_t>(number - 1)].push_back(name);
    }
  }
  return tables;
}

ScenarioValues together(const FleetSettings& fleet, const std::vector<std::string>& tables,
                        int number, const std::string& file) {
  std::map<std::string, std::string> from;
  ScenarioValues values;
  for (const std::string& table : tables) {
    for (const auto& [key, value] : fleet.own.at(table)) {
      if (!values.emplace(key, value).second) {
        throw UsageError(fmt::format("{0}: vehicle {1} has {2} twice: {3}{4}.{2} and {3}{5}.{2}",
                                     file, number, key, kPrefix, from[key], table));
      }
      from[key] = table;
    }
  }
  return values;
}

/// Values in which a resolved scenario differs from that of the others, and empty values of
/// `given`, which a resolved scenario cannot express.
ScenarioValues difference(const Scenario& one, const ScenarioValues& given,
                          const ScenarioValues& said) {
  ScenarioValues values;
  for (const ScenarioKey& key : one.schema().keys()) {
    const auto value = given.find(key.name);
    const bool is_unset = value != given.end() && said.contains(key.name) && !key.get(one);
    if (is_unset) values.insert(*value);
  }
  for (auto& [key, value] : one.schema().values_of(one)) {
    const auto other = said.find(key);
    const bool is_same = other != said.end() && other->second == value;
    if (!is_same && may_differ(key)) values.emplace(key, std::move(value));
  }
  return values;
}

}  // namespace

std::vector<int> vehicle_numbers(const std::string& text) {
  std::vector<int> numbers;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    const std::string part = text.substr(begin, end - begin);
    const std::size_t dash = part.find('-');
    const auto first = vehicle_number(part.substr(0, dash));
    const auto last = dash == std::string::npos ? first : vehicle_number(part.substr(dash + 1));
    if (!first || !last || *last < *first) return {};
    if (!numbers.empty() && *first <= numbers.back()) return {};
    for (int number = *first; number <= *last; ++number) numbers.push_back(number);
    begin = end + 1;
  }
  return numbers;
}

std::string numbers_text(const std::vector<int>& numbers) {
  std::string text;
  for (std::size_t i = 0; i < numbers.size();) {
    std::size_t end = i + 1;
    while (end < numbers.size() && numbers[end] == numbers[end - 1] + 1) ++end;
    if (!text.empty()) text += ",";
    text += fmt::format("{}", numbers[i]);
    if (end > i + 1) text += fmt::format("-{}", numbers[end - 1]);
    i = end;
  }
  return text;
}

bool may_differ(const std::string& key) {
  const auto begins = [&key](std::string_view prefix) { return key.starts_with(prefix); };
  return std::any_of(kDiffer.begin(), kDiffer.end(), begins) &&
         std::find(kShared.begin(), kShared.end(), key) == kShared.end();
}

NamedTables own_tables() {
  NamedTables tables;
  tables.prefix = kPrefix;
  tables.names = [](const Scenario& scenario) {
    std::vector<std::string> names;
    for (const auto& [name, values] : scenario.get<FleetSettings>().own) names.push_back(name);
    return names;
  };
  tables.keys = [](const std::string& name) {
    std::vector<ScenarioKey> keys;
    for (const ScenarioKey& key : ScenarioSchema::all()->keys()) {
      if (may_differ(key.name)) keys.push_back(own_key(key, name));
    }
    return keys;
  };
  tables.make = [](Scenario& scenario, const std::string& name, const std::string& place) {
    if (vehicle_numbers(name).empty()) {
      throw UsageError(fmt::format(
          "{}: {}{} is not allowed: must be numbers of vehicles from 1 to {} that ascend, such as "
          "3, 3-5 or \"1,4-6\"",
          place, kPrefix, printable(name, kLongestNameShown), kMostVehicles));
    }
    scenario.get<FleetSettings>().own.try_emplace(name);
  };
  tables.why_not = why_shared;
  return tables;
}

std::vector<std::string> own_keys_meant_by(const std::string& key) {
  if (!key.starts_with(kPrefix)) return {};
  const std::size_t dot = key.find('.', kPrefix.size());
  if (dot == std::string::npos) return {};
  std::vector<std::string> keys = ScenarioSchema::all()->keys_meant_by(key.substr(dot + 1));
  for (std::string& one : keys) one.insert(0, key, 0, dot + 1);
  return keys;
}

void make_variants(Scenario& scenario, const ScenarioWith& with, const std::string& file) {
  auto& fleet = scenario.get<FleetSettings>();
  if (fleet.own.empty() || fleet.count > kMostVehicles) return;
  const auto tables = tables_of_vehicles(fleet, file);
  std::map<std::vector<std::string>, std::vector<int>> numbers_of;
  for (int number = 1; number <= fleet.count; ++number) {
    const auto& its = tables[static_cast<std::size_t>(number - 1)];
    if (!its.empty()) numbers_of[its].push_back(number);
  }
  const FleetSettings given = fleet;
  fleet.own.clear();
  const FleetSettings bare = fleet;
  const auto common = scenario.schema().values_of(scenario);
  const ScenarioValues said(common.begin(), common.end());
  for (const auto& [its, numbers] : numbers_of) {
    const ScenarioValues values = together(given, its, numbers.front(), file);
    const std::string name = numbers_text(numbers);
    auto one =
        std::make_shared<Scenario>(with(values, fmt::format("{}: {}{}", file, kPrefix, name)));
    one->get<FleetSettings>() = bare;
    ScenarioValues differs = difference(*one, values, said);
    if (differs.empty()) continue;
    fleet.own.emplace(name, differs);
    fleet.variants.push_back({numbers, std::move(differs), std::move(one)});
  }
}

}  // namespace tether
