#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// The node that publishes each channel of a run; no other may. Nodes are named as in lockstep:
/// "sim", "netem", "controller", "can", "autonomy", "localiser".
using ChannelOwners = std::map<std::string, std::string, std::less<>>;

/// `members`: the scenario of each vehicle.
ChannelOwners channel_owners(const std::vector<Scenario>& members);

}  // namespace tether
