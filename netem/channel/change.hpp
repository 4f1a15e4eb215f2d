#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "netem/channel/settings.hpp"

namespace tether {

/// One setting of the channel, its key without "channel.": "downlink.prr", "0.45".
struct ChannelSetting {
  std::string key;
  std::string value;  ///< in TOML's syntax

  bool operator==(const ChannelSetting&) const = default;
};

/// A scenario of the section "channel" alone.
Scenario channel_scenario(const ChannelSettings& channel);

/// The longest key that requests may have, so that no request takes long to refuse.
inline constexpr std::size_t kLongestSettingKey = 128;

/// Other settings for a channel that is in use, all at once.
struct ChannelChange {
  ChannelSettings channel;
  std::vector<ChannelSetting> settings;  ///< given or changed settings, with their present values
};

/// The channel with other settings. `settings` are "KEY=VALUE" with keys as --set
/// has them behind "channel." ("downlink.prr=0.45"; "prr=0.45" is both links'), and what is allowed
/// is what --set allows on top of what is in force now. Names of files are as given. Throws
/// UsageError with the reason, which begins with `source` if there is one; the links' files are not
/// looked at here.
ChannelChange change_channel(const ChannelSettings& in_force,
                             const std::vector<std::string>& settings,
                             const std::string& source = "");

/// The file that a setting names; nullopt if it names none.
std::optional<std::string> file_of_setting(const std::string& setting);

/// A setting that names a file, with the name in `folder` unless it is absolute; others as they
/// are.
std::string setting_in_folder(const std::string& setting, const std::filesystem::path& folder);

/// The settings that differ from the defaults, in the order of `tether run --keys`, then those of
/// links by name.
std::vector<ChannelSetting> channel_settings(const ChannelSettings& channel);

/// The files that the channel's keys name.
std::vector<std::string> channel_files(const ChannelSettings& channel);

/// Checks each of channel.change against the settings in force by then. Throws UsageError.
void check_changes(const ChannelSettings& channel, const std::string& file);

}  // namespace tether
