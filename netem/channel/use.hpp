#pragma once

#include <string>
#include <vector>

#include "netem/channel/change.hpp"

namespace tether {

/// Which links of a channel a relay uses: what its settings may be about.
struct ChannelUse {
  std::vector<std::string> links;  ///< "uplink", "downlink", names of [channel.links]
  bool by_rules = false;           ///< for any LCM traffic: the vehicle's position is not known

  /// Refuses a setting, "KEY=VALUE" with or without "channel." before the key, of links that the
  /// relay does not use. One that means both ways ("prr=0.5") needs one of them. Throws UsageError,
  /// which names the links in use.
  void check(const std::string& setting) const;

  /// Refuses a model that needs the vehicle's position if the position is not known. Throws
  /// UsageError.
  void check_models(const ChannelSettings& channel) const;

  /// Settings of links in use.
  std::vector<ChannelSetting> select(std::vector<ChannelSetting> settings) const;

 private:
  bool covers(const std::string& key) const;
};

/// Refuses those values of --set that are about the channel but about no link in use. Throws
/// UsageError.
void check_overrides(const ChannelUse& use, const std::vector<std::string>& overrides);

/// The vehicle's two.
inline const ChannelUse kVehicleLinks{{"uplink", "downlink"}};

/// Why a link cannot be used by rules: its model needs to know where the vehicle is; "" if it can.
std::string why_not_by_rules(const std::string& name, const LinkConfig& link);

/// Prefix of a link's keys: "channel.uplink." or "channel.links.sat.".
std::string link_key(const std::string& name);

/// The settings of a link by its name.
const LinkConfig& link_config(const ChannelSettings& channel, const std::string& name);

}  // namespace tether
