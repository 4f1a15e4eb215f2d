#pragma once

#include <string>

#include "common/scenario/section.hpp"

namespace tether {

template <class Settings>
bool sends_changes(const Settings& sender) {
  return sender.send == Settings::Send::changed;
}

/// Tells [medium] what vehicles send over it, and how often: poses up, commands or plans down, and
/// what goes up beside poses: odometry, a scan's parts with localiser.place = "edge", what the
/// localiser says with "vehicle". Of what is sent when it changes: at least, and at most. Not
/// autonomy's reports.
void take_traffic(Scenario& scenario);

/// Checks the needs of medium.keep = "newest" and serve = "most_valuable". Throws UsageError.
void check_keeping(const Scenario& scenario, const std::string& file);

}  // namespace tether
