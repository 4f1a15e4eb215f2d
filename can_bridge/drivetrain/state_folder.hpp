#pragma once

#include <filesystem>
#include <string>

namespace tether {

/// Where a vehicle's programs keep what they have to remember of its drivetrain: $STATE_DIRECTORY
/// (systemd), else $XDG_STATE_HOME/tether, else ~/.local/state/tether, else /var/lib/tether.
std::filesystem::path state_folder();

/// The record of `tether can commission`: commissioned.VEHICLE.INTERFACE.toml there.
std::filesystem::path default_commission_record(const std::string& vehicle,
                                                const std::string& interface);

}  // namespace tether
