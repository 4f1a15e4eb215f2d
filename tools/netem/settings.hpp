#pragma once

#include <string>
#include <vector>

namespace tether {

// Each sends a request to the relay that is running on an LCM network, and waits for its answer for
// at most 3 s. It prints to standard output and returns the exit code. std::runtime_error says that
// there is no relay, UsageError what is wrong with a setting that is not "KEY=VALUE".

/// Asks for other settings of the channel, all at once. Returns 0 if they are in force, 1 if they
/// were refused.
int netem_set(const std::string& lcm_url, const std::vector<std::string>& settings);

/// Shows the settings in force that differ from the defaults.
int netem_show(const std::string& lcm_url);

}  // namespace tether
