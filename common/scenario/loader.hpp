#pragma once

#include <toml++/toml.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// The keys that an override's key stands for: channel.prr is channel.uplink.prr and
/// channel.downlink.prr.
std::vector<std::string> keys_meant_by(const std::string& key);

/// Applies values to a scenario, level by level (the file, then the overrides), and remembers which
/// keys were given where. All functions throw UsageError for what is wrong with a value, with
/// `place`, where it was given ("paper.toml:12" or "--set prr=2"), the key and what is allowed.
class ScenarioLoader {
 public:
  ScenarioLoader() = default;
  /// For changes of the channel of a scenario that is whole.
  explicit ScenarioLoader(Scenario start) : scenario_(std::move(start)), is_whole_(true) {}

  /// What a file has.
  void apply_table(const toml::table& table, const std::string& prefix, const std::string& file);

  /// `text` is "KEY=VALUE"; channel.X stands for channel.uplink.X and
  /// channel.downlink.X; channel.links.NAME.X makes the link where there is none.
  void apply_override(const std::string& text, const std::string& place);

  /// Ends a level of settings, the file or the overrides: checks that each has an effect and turns
  /// stationary probabilities into sojourn times, so that the next level beats them in either form.
  /// Names of files are relative to `folder`.
  void end_level(const std::string& source, const std::filesystem::path& folder);

  /// Full names of the keys that were given at this level.
  const std::set<std::string>& given() const { return given_; }

  /// Checks the scenario as a whole and returns it. Unless it was whole at the beginning, the path
  /// is planned, which reads path.csv, and checked, and the vehicle put at its start.
  Scenario finish(const std::string& file) const;

 private:
  void make_link(const std::string& key, const std::string& place);
  void apply(const std::string& key, const toml::node& node, const std::string& place);
  void read_changes(const toml::node& node, const std::string& place);
  void set_derived(const std::string& key, double value, const std::string& from,
                   const std::string& file);
  void check_effect(const std::string& prefix, const LinkConfig& link,
                    const std::string& source) const;
  void check_plant_and_path(const std::string& source) const;

  Scenario scenario_;
  bool is_whole_ = false;
  std::set<std::string> given_;        // at this level
  std::set<std::string> start_given_;  // of vehicle.start_…, at any level
};

/// What a scenario file says over the defaults; its level is ended. Throws UsageError.
ScenarioLoader start_from_file(const std::string& file);

}  // namespace tether
