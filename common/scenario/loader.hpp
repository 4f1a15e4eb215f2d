#pragma once

#include <toml++/toml.h>

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/scenario/section.hpp"

namespace tether {

/// A value of TOML as keys take it; none if no key could, as a table or a mixed list.
std::optional<ScenarioValue> to_value(const toml::node& node);

/// Applies values to a scenario, level by level (the file, then the overrides), and remembers which
/// keys were given where. All functions throw UsageError for what is wrong with a value, with
/// `place`, where it was given ("paper.toml:12" or "--set prr=2"), the key and what is allowed.
class ScenarioLoader {
 public:
  ScenarioLoader() = default;
  explicit ScenarioLoader(Scenario start) : scenario_(std::move(start)) {}

  /// Applies what a file has.
  void apply_table(const toml::table& table, const std::string& prefix, const std::string& file);

  /// `text` is "KEY=VALUE"; a key may stand for several (ScenarioSchema::keys_meant_by) and makes
  /// the named table that it is in. `prefix`: start of all keys that the caller left out
  /// ("channel."), also left out in errors about unknown keys.
  void apply_override(const std::string& text, const std::string& place,
                      std::string_view prefix = "");

  /// Ends a level of settings, the file or the overrides: checks that each has an effect and lets
  /// the sections resolve theirs, so that the next level beats them in either form. Names of files
  /// are relative to `folder`.
  void end_level(const std::string& source, const std::filesystem::path& folder);

  /// Why a key, by its full name, has no effect on what was applied so far; "" if it has one.
  std::string why_no_effect(const std::string& key) const;

  /// Full names of the keys that were given at this level.
  const std::set<std::string>& given() const { return given_; }

  /// Completes and checks the scenario as a whole and returns it: the path is planned, which reads
  /// path.csv, and the vehicle put at its start.
  Scenario finish(const std::string& file) const;

 private:
  Scenario completed(const std::string& file) const;
  Scenario with(const ScenarioValues& values, const std::string& source) const;
  const std::vector<ScenarioKey>& keys_beside(const std::string& key);
  const ScenarioKey* find_key(const std::string& key);
  std::string why_switched_off(const std::string& key) const;
  /// `short_forms`: those of overrides ("channel.prr") may be meant, too.
  [[noreturn]] void refuse_unknown(const std::string& place, const std::string& key,
                                   std::string_view prefix = "", bool short_forms = false);
  void make_table(const std::string& key, const std::string& place);
  void apply(const std::string& key, const toml::node& node, const std::string& place);
  bool apply_list(const std::string& key, const toml::node& node, const std::string& place);
  void set_derived(const std::string& key, double value, const std::string& from,
                   const std::string& file);

  Scenario scenario_;
  std::set<std::string> given_;                                 // at this level
  std::set<std::string> given_at_any_;                          // and at those before
  std::map<std::string, std::vector<ScenarioKey>> named_keys_;  // by "channel.links.NAME"
};

/// Values of a scenario file over the defaults; its level is ended. Throws UsageError.
ScenarioLoader start_from_file(const std::string& file);

}  // namespace tether
