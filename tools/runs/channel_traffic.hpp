#pragma once

#include "common/scenario/scenario.hpp"
#include "netem/check/channel_watch.hpp"

namespace tether {

/// Poses of a scenario's sensor.
LinkTraffic pose_traffic(const Scenario& scenario);
/// Commands or plans of a scenario's controller, with trigger = event one for each pose; `in_loop`:
/// only for those that the uplink brings, when it brings them.
LinkTraffic command_traffic(const Scenario& scenario, bool in_loop);
/// Traffic through both links.
ChannelTraffic channel_traffic(const Scenario& scenario, bool in_loop);

}  // namespace tether
