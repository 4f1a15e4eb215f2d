#include "netem/channel/change.hpp"

#include <fmt/format.h>

#include <limits>
#include <memory>
#include <set>

#include "common/base/errors.hpp"
#include "common/base/pattern.hpp"
#include "common/scenario/loader.hpp"

namespace tether {
namespace {

const std::string kSettingPrefix = "channel.";

/// With those of its links by name that `channel` has, at their defaults unless they are there.
ChannelSettings with_links_of(const ChannelSettings& channel, ChannelSettings other) {
  for (const auto& [name, link] : channel.links) other.links.try_emplace(name);
  return other;
}

/// Keys of the channel that are set, and were given or have another value than in `before`.
std::vector<ChannelSetting> differences(const ChannelSettings& channel,
                                        const ChannelSettings& before,
                                        const std::set<std::string>& given = {}) {
  const Scenario now = channel_scenario(channel);
  const Scenario then = channel_scenario(with_links_of(channel, before));
  std::vector<ChannelSetting> found;
  for (const ScenarioKey& key : now.schema().keys_of(now)) {
    const auto value = key.get(now);
    if (!value || (value == key.get(then) && !given.contains(key.name))) continue;
    found.push_back({key.name.substr(kSettingPrefix.size()), to_toml(*value)});
  }
  return found;
}

void apply(ScenarioLoader& loader, const std::string& setting, const std::string& place) {
  if (setting.find('=') != std::string::npos && setting.find('=') > kLongestSettingKey) {
    throw UsageError(fmt::format("{}...: a key has at most {} characters",
                                 place.substr(0, place.size() - setting.size() + 20),
                                 kLongestSettingKey));
  }
  const bool is_whole = setting.starts_with(kSettingPrefix);
  loader.apply_override(setting, place, is_whole ? "" : kSettingPrefix);
}

}  // namespace

Scenario channel_scenario(const ChannelSettings& channel) {
  static const auto kSchema =
      std::make_shared<const ScenarioSchema>(std::vector<ScenarioSection>{channel_section()});
  Scenario scenario(kSchema);
  scenario.get<ChannelSettings>() = channel;
  return scenario;
}

ChannelChange change_channel(const ChannelSettings& in_force,
                             const std::vector<std::string>& settings, const std::string& source) {
  ChannelSettings start = in_force;
  start.changes.clear();  // not for changes to change
  ScenarioLoader loader(channel_scenario(start));
  const std::string before = source.empty() ? "" : source + ": ";
  for (const std::string& text : settings) apply(loader, text, before + text);
  const std::set<std::string> given = loader.given();
  if (given.contains("channel.change")) {
    throw UsageError(before + "channel.change cannot be changed by a change");
  }
  const std::string level = source.empty() ? "settings" : source;
  loader.end_level(level, {});
  ChannelChange change{loader.finish(level).get<ChannelSettings>(), {}};
  change.channel.changes = in_force.changes;
  change.settings = differences(change.channel, in_force, given);
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

std::vector<ChannelSetting> channel_settings(const ChannelSettings& channel) {
  return differences(channel, {});
}

std::vector<std::string> channel_files(const ChannelSettings& channel) {
  Scenario scenario = channel_scenario(channel);
  std::vector<std::string> files;
  for (const ScenarioKey& key : scenario.schema().keys_of(scenario)) {
    if (key.file && !key.file(scenario).empty()) files.push_back(key.file(scenario));
  }
  return files;
}

void check_changes(const ChannelSettings& channel, const std::string& file) {
  ChannelSettings in_force = channel;
  double earliest_s = -std::numeric_limits<double>::infinity();
  for (const ChannelSettings::Change& change : channel.changes) {
    const std::string source = fmt::format("{}: channel.change at {} s", file, change.at_s);
    if (change.at_s < earliest_s) {
      throw UsageError(
          fmt::format("{} comes after the one at {} s: times must ascend", source, earliest_s));
    }
    earliest_s = change.at_s;
    in_force = change_channel(in_force, change.settings, source).channel;
  }
}

}  // namespace tether
