#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "netem/check/channel_watch.hpp"

namespace tether {

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
