#pragma once

#include <string>

#include "common/scenario_key_table.hpp"

namespace tether {

/// One direction of a scenario's channel, const or mutable as the scenario is.
struct LinkSelect {
  bool uplink = true;

  auto& operator()(auto& scenario) const {
    return uplink ? scenario.channel.uplink : scenario.channel.downlink;
  }
};

// One line a key: the member of the link that `link`, a LinkSelect, chooses.
#define TETHER_LINK(member) ([link](auto& s) -> auto& { return link(s).member; })

/// All keys that begin with "channel.".
void add_channel_keys(KeyTable& t);

/// Those under "<prefix>trace." and "<prefix>map.".
void add_trace_and_map_keys(KeyTable& t, const std::string& prefix, LinkSelect link);

}  // namespace tether
