#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "common/scenario/scenario.hpp"
#include "netem/fit/channel_watch.hpp"

namespace tether {

/// Poses of a scenario's sensor.
LinkTraffic pose_traffic(const Scenario& scenario);
/// Commands or plans of a scenario's controller, with trigger = event one for each pose; `in_loop`:
/// only for those that the uplink brings, when it brings them.
LinkTraffic command_traffic(const Scenario& scenario, bool in_loop);
/// Traffic through both links.
ChannelTraffic channel_traffic(const Scenario& scenario, bool in_loop);

/// `channel_check` (the verdict on all quantities together) and `check`, a list of quantity, unit,
/// configured, achieved, low and high (of the 95 % interval), verdict and, if there is one, reason.
/// What is unknown or unbounded is null.
nlohmann::ordered_json to_json(const ChannelReport::Direction& link);

/// For a run's summary: one line that says which quantities are as configured, which are undecided
/// and which are not comparable; and a row for each that is outside.
std::string to_text(const ChannelReport::Direction& link);

/// All quantities, a row each.
std::string to_table(const ChannelReport::Direction& link);

}  // namespace tether
