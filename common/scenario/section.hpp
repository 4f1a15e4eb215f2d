#pragma once

#include <any>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

using NumberList = std::vector<double>;
using NumberRows = std::vector<NumberList>;
using TextList = std::vector<std::string>;

/// A value of a scenario key, as TOML has it.
using ScenarioValue =
    std::variant<bool, std::int64_t, double, std::string, NumberList, NumberRows, TextList>;

/// The value in TOML's syntax: the shortest text that reads as the same value.
std::string to_toml(const ScenarioValue& value);

/// One key of the scenario file: the single place that knows its name, type, range and meaning.
struct ScenarioKey {
  std::string name;     ///< dotted, such as "channel.uplink.prr"
  std::string allowed;  ///< for messages: "a number in [0, 1]"
  std::string meaning;  ///< one line, with unit
  /// nullopt: not set, left out of the resolved scenario.
  std::function<std::optional<ScenarioValue>(const Scenario&)> get;
  /// False if `value` is of the wrong type or out of range; then nothing changes.
  std::function<bool(Scenario&, const ScenarioValue&)> set;
  /// For keys that name a file: the name, which is relative to where it was given. Empty for
  /// others.
  std::function<std::string&(Scenario&)> file = {};
};

/// Values given at one level of settings: in the file, or by the overrides.
struct ScenarioLevel {
  std::string source;            ///< for messages
  std::filesystem::path folder;  ///< by now, names of files given here begin with it
  std::set<std::string> keys;    ///< full names
  /// Sets a key to what follows from others, within the same limits as if it had been given.
  std::function<void(const std::string& key, double value, const std::string& from)> set_derived;

  bool has(const std::string& key) const { return keys.contains(key); }
};

/// Tables that the scenario file names itself, such as [channel.links.NAME].
struct NamedTables {
  std::string prefix;  ///< "channel.links."
  std::function<std::vector<std::string>(const Scenario&)> names;
  std::function<std::vector<ScenarioKey>(const std::string& name)> keys;
  /// Makes the table where there is none. Throws UsageError, which begins with `place`, if it must
  /// not have this name.
  std::function<void(Scenario&, const std::string& name, const std::string& place)> make;
  /// Why tables cannot have the key that is `part` behind their name, though the scenario has it;
  /// "" if it has not.
  std::function<std::string(const std::string& part)> why_not = {};
};

/// A list of tables, such as [[channel.change]].
struct TableList {
  using Table = std::map<std::string, ScenarioValue>;
  std::string key;      ///< "channel.change"
  std::string allowed;  ///< for messages: "each [[channel.change]] must have …"
  /// Replaces the whole list. False if one of the tables is not as it must be; throws UsageError,
  /// which begins with `place`, to say more than `allowed`.
  std::function<bool(Scenario&, const std::vector<Table>&, const std::string& place)> read;
  std::function<std::string(const Scenario&)> to_toml;
};

/// A key that says more of something which switches turn on. With all of them off it has no effect
/// and is left out of the resolved scenario; to give it is a mistake, unless the same level gives a
/// switch: a sweep may have 0 among others.
struct SwitchedKey {
  std::string key;                    ///< full name
  std::vector<std::string> switches;  ///< full names
  ScenarioValue off = 0.0;            ///< value that switches them off
};

using ScenarioValues = std::map<std::string, ScenarioValue>;  ///< by full name

/// The scenario, if these keys were given as well, after all others: completed, not checked. Throws
/// UsageError, which begins with `source`, for one that has no effect.
using ScenarioWith = std::function<Scenario(const ScenarioValues&, const std::string& source)>;

/// A section of the scenario: a struct of settings with its keys and all that is to be said of
/// them. A room gives one for each struct that it owns. What is left empty does nothing.
struct ScenarioSection {
  std::any defaults;              ///< the settings
  std::vector<ScenarioKey> keys;  ///< in the order of the resolved scenario
  std::optional<NamedTables> named = {};
  std::optional<TableList> list = {};
  std::string help = {};  ///< behind the keys' table

  /// Why `key` has no effect, such as `vehicle.plant is "kinematic"`: then it is a mistake to give
  /// it. "" if it has an effect.
  std::function<std::string(const Scenario&, const std::string& key)> why_no_effect = {};
  std::vector<SwitchedKey> switched = {};
  /// Whether `key` is left out of the resolved scenario: because it has no effect, although it is
  /// no mistake to give it (one file may hold the keys of several choices); or because it is a
  /// switch at its default.
  std::function<bool(const Scenario&, const ScenarioKey& key)> left_out = {};

  /// The keys that `key` stands for: channel.prr is channel.uplink.prr and channel.downlink.prr.
  std::function<std::vector<std::string>(const std::string& key)> stands_for = {};
  /// The shorter key that stands for `key`, and others; "" if there is none.
  std::function<std::string(const std::string& key)> short_form = {};

  /// At the end of each level, so that the next one beats it: turns keys that stand for others into
  /// these. Throws UsageError.
  std::function<void(Scenario&, const ScenarioLevel&)> end_level = {};
  /// Called once at the end: sets what follows from other sections and was not given at any level.
  /// `given`: the keys that were.
  std::function<void(Scenario&, const std::set<std::string>& given, const std::string& file)>
      complete = {};
  /// Called once after all are complete: makes what differs from the scenario in some keys.
  std::function<void(Scenario&, const ScenarioWith&, const std::string& file)> vary = {};
  /// Checks what several keys must fulfil together, of any sections. Throws UsageError.
  std::function<void(const Scenario&, const std::string& file)> check = {};
};

/// All sections. Defined in scenarios/sections.cpp, above the rooms that have them.
std::vector<ScenarioSection> scenario_sections();

/// Sections that belong together, and their keys.
class ScenarioSchema {
 public:
  explicit ScenarioSchema(std::vector<ScenarioSection> sections);

  /// Schema of all sections; made once.
  static std::shared_ptr<const ScenarioSchema> all();

  const std::vector<ScenarioSection>& sections() const { return sections_; }
  /// All keys but those of named tables.
  const std::vector<ScenarioKey>& keys() const { return keys_; }
  /// All keys, and those of the named tables that `scenario` has.
  std::vector<ScenarioKey> keys_of(const Scenario& scenario) const;

  /// All that the resolved scenario says, but for lists of tables; in its order.
  std::vector<std::pair<std::string, ScenarioValue>> values_of(const Scenario& scenario) const;

  /// Why `key` does nothing, of any section; "" if it has an effect.
  std::string why_no_effect(const Scenario& scenario, const std::string& key) const;
  bool left_out(const Scenario& scenario, const ScenarioKey& key) const;
  /// The switches of `key`, if it has some and all are off: then it has no effect.
  const SwitchedKey* switched_off(const Scenario& scenario, const std::string& key) const;
  /// The keys that `key` stands for: itself, or several.
  std::vector<std::string> keys_meant_by(const std::string& key) const;

 private:
  std::vector<ScenarioSection> sections_;
  std::vector<ScenarioKey> keys_;
};

}  // namespace tether
