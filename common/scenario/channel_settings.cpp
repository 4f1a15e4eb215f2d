#include "common/scenario/channel_settings.hpp"

#include <fmt/format.h>

#include <functional>
#include <limits>

#include "common/base/errors.hpp"
#include "common/base/pattern.hpp"
#include "common/scenario/keys.hpp"
#include "common/scenario/loader.hpp"

namespace tether {
namespace {

const std::string kPrefix = "channel.";

/// With those of its links by name that `scenario` has, at their defaults unless they are there.
Scenario with_links_of(const Scenario& scenario, Scenario other) {
  for (const auto& [name, link] : scenario.channel.links) other.channel.links.try_emplace(name);
  return other;
}

/// Those of the channel's keys that `which` selects and that are set, with their values.
std::vector<ChannelSetting> select(const Scenario& scenario,
                                   const std::function<bool(const ScenarioKey&)>& which) {
  std::vector<ScenarioKey> keys = scenario_keys();
  for (const auto& [name, link] : scenario.channel.links) {
    const std::vector<ScenarioKey> more = named_link_keys(name);
    keys.insert(keys.end(), more.begin(), more.end());
  }
  std::vector<ChannelSetting> found;
  for (const ScenarioKey& key : keys) {
    const auto value = key.get(scenario);
    if (!value || !key.name.starts_with(kPrefix) || !which(key)) continue;
    found.push_back({key.name.substr(kPrefix.size()), to_toml(*value)});
  }
  return found;
}

void apply(ScenarioLoader& loader, const std::string& setting, const std::string& place) {
  if (setting.find('=') != std::string::npos && setting.find('=') > kLongestSettingKey) {
    throw UsageError(fmt::format("{}...: a key has at most {} characters",
                                 place.substr(0, place.size() - setting.size() + 20),
                                 kLongestSettingKey));
  }
  const bool is_whole = setting.starts_with(kPrefix);
  loader.apply_override(is_whole ? setting : kPrefix + setting, place);
}

}  // namespace

ChannelChange change_channel(const Scenario& in_force, const std::vector<std::string>& settings,
                             const std::string& source) {
  Scenario start = in_force;
  start.channel.changes.clear();  // not for changes to change
  ScenarioLoader loader(start);
  const std::string before = source.empty() ? "" : source + ": ";
  for (const std::string& text : settings) apply(loader, text, before + text);
  const std::set<std::string> given = loader.given();
  if (given.contains("channel.change")) {
    throw UsageError(before + "channel.change cannot be changed by a change");
  }
  const std::string level = source.empty() ? "settings" : source;
  loader.end_level(level, {});
  ChannelChange change{loader.finish(level), {}};
  change.scenario.channel.changes = in_force.channel.changes;
  const Scenario before_change = with_links_of(change.scenario, in_force);
  change.settings = select(change.scenario, [&](const ScenarioKey& key) {
    return given.contains(key.name) || key.get(change.scenario) != key.get(before_change);
  });
  return change;
}

namespace {

/// Key and name, if the setting names a file.
std::optional<std::vector<std::string>> parts_of_file_setting(const std::string& setting) {
  static const Pattern kFile(R"( *([^ =]*\.file) *= *["']?([^"']*?)["']? *)");
  return kFile.groups(setting);
}

}  // namespace

std::optional<std::string> file_of_setting(const std::string& setting) {
  const auto part = parts_of_file_setting(setting);
  return part ? std::optional(part->at(1)) : std::nullopt;
}

std::string setting_in_folder(const std::string& setting, const std::filesystem::path& folder) {
  const auto part = parts_of_file_setting(setting);
  if (!part) return setting;
  const std::filesystem::path file = folder / part->at(1);
  return fmt::format("{}=\"{}\"", part->at(0), file.lexically_normal().string());
}

std::vector<ChannelSetting> channel_settings(const Scenario& scenario) {
  const Scenario defaults = with_links_of(scenario, {});
  return select(scenario,
                [&](const ScenarioKey& key) { return key.get(scenario) != key.get(defaults); });
}

void check_changes(const Scenario& scenario, const std::string& file) {
  Scenario in_force = scenario;
  double earliest_s = -std::numeric_limits<double>::infinity();
  for (const Scenario::Channel::Change& change : scenario.channel.changes) {
    const std::string source = fmt::format("{}: channel.change at {} s", file, change.at_s);
    if (change.at_s < earliest_s) {
      throw UsageError(
          fmt::format("{} comes after the one at {} s: times must ascend", source, earliest_s));
    }
    earliest_s = change.at_s;
    in_force = change_channel(in_force, change.settings, source).scenario;
  }
}

}  // namespace tether
