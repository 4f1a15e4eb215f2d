#pragma once

#include <any>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

namespace tether {

class ScenarioSchema;

/// All that a run depends on: a struct of settings for each section of the scenario file, found by
/// its type, as in scenario.get<VehicleSettings>(). The sections themselves, with their defaults,
/// keys and checks, are in the rooms that use them; scenarios/sections.cpp lists them.
/// scenarios/paper.toml is the paper's setting, commented.
class Scenario {
 public:
  /// All sections, with their defaults.
  Scenario();
  /// The sections of this schema alone, with their defaults.
  explicit Scenario(std::shared_ptr<const ScenarioSchema> schema);

  /// Throws std::logic_error if the schema has no such section.
  template <class Settings>
  const Settings& get() const {
    return find<const Settings>(sections_);
  }
  template <class Settings>
  Settings& get() {
    return find<Settings>(sections_);
  }

  const ScenarioSchema& schema() const { return *schema_; }

  /// Takes one of the schema's sections, by its number, from another scenario of the same schema.
  void take_section(const Scenario& other, std::size_t number) {
    sections_.at(number) = other.sections_.at(number);
  }

 private:
  template <class Settings, class Sections>
  static Settings& find(Sections& sections) {
    for (auto& section : sections) {
      if (auto* found = std::any_cast<std::remove_const_t<Settings>>(&section)) return *found;
    }
    throw std::logic_error("no such section in this scenario");
  }

  std::shared_ptr<const ScenarioSchema> schema_;
  std::vector<std::any> sections_;
};

/// Some sections of a scenario: what nodes and laws take, so that they depend on no others.
template <class... Settings>
class Sections {
 public:
  Sections(const Scenario& scenario)  // NOLINT(google-explicit-constructor)
      : settings_(scenario.get<Settings>()...) {}
  /// From one that has these sections and more.
  template <class... More>
  Sections(const Sections<More...>& more)  // NOLINT(google-explicit-constructor)
      : settings_(more.template get<Settings>()...) {}

  template <class One>
  const One& get() const {
    return std::get<One>(settings_);
  }
  template <class One>
  One& get() {
    return std::get<One>(settings_);
  }

 private:
  std::tuple<Settings...> settings_;
};

/// Reads a scenario file over the defaults, then applies `overrides` ("key=value", in TOML's
/// notation; quotes around strings may be left out; channel.X means channel.uplink.X and
/// channel.downlink.X; channel.links.NAME.X makes the link where there is none) in order. Each of
/// channel.change is checked against the settings that are in force by then. Throws UsageError that
/// names file, line, key and what is allowed.
Scenario load_scenario(const std::string& file, const std::vector<std::string>& overrides);

/// The same from text; `name` stands in for the file in messages.
Scenario parse_scenario(const std::string& toml, const std::string& name,
                        const std::vector<std::string>& overrides = {});

/// Returns a line for each setting that is allowed and hardly meant, such as keys that contradict
/// each other; in scenarios/sections.cpp.
std::vector<std::string> scenario_warnings(const Scenario& scenario);

/// The resolved scenario as TOML: every key that has an effect, and reading it gives the same run
/// again.
std::string to_toml(const Scenario& scenario);

/// A table of all keys with their defaults, allowed values and meaning, for people.
std::string describe_scenario_keys();

}  // namespace tether
