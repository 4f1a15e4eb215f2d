#pragma once

#include <map>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// The node of lockstep_nodes() that publishes each channel of a run; no other may.
using ChannelOwners = std::map<std::string, std::string>;

/// `members`: the scenario of each vehicle.
ChannelOwners channel_owners(const std::vector<Scenario>& members);

}  // namespace tether
