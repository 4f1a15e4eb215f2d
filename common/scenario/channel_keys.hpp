#pragma once

#include <string>

#include "common/scenario/key_table.hpp"

namespace tether {

/// A link of a scenario's channel, const or mutable as the scenario is.
struct LinkSelect {
  enum class Which { uplink, downlink, by_name };
  Which which = Which::uplink;
  std::string name;  ///< by_name: in [channel.links]

  LinkConfig& operator()(Scenario& scenario) const {
    Scenario::Channel& channel = scenario.channel;
    if (which == Which::by_name) return channel.links[name];
    return which == Which::uplink ? channel.uplink : channel.downlink;
  }
  /// A link that the scenario does not have is a default one.
  const LinkConfig& operator()(const Scenario& scenario) const {
    static const LinkConfig kDefault;
    const Scenario::Channel& channel = scenario.channel;
    if (which != Which::by_name) {
      return which == Which::uplink ? channel.uplink : channel.downlink;
    }
    const auto found = channel.links.find(name);
    return found == channel.links.end() ? kDefault : found->second;
  }
};

// One line a key: the member of the link that `link`, a LinkSelect, chooses.
#define TETHER_LINK(member) ([link](auto& s) -> auto& { return link(s).member; })

/// All keys that begin with "channel.", but for those of links by name.
void add_channel_keys(KeyTable& t);

/// The keys of one link; they begin with `prefix`.
void add_link_keys(KeyTable& t, const std::string& prefix, const LinkSelect& link);

/// Those under "<prefix>trace." and "<prefix>map.".
void add_trace_and_map_keys(KeyTable& t, const std::string& prefix, const LinkSelect& link);

}  // namespace tether
