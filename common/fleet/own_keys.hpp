#pragma once

#include <string>
#include <vector>

#include "common/fleet/fleet.hpp"

namespace tether {

/// The numbers that a text such as "3", "3-5" or "1,4-6" means, ascending and from 1 to
/// kMostVehicles; none if it is no such text.
std::vector<int> vehicle_numbers(const std::string& text);
/// The shortest such text; `numbers` ascend.
std::string numbers_text(const std::vector<int>& numbers);

/// Whether vehicles of a fleet may differ in a key of the scenario.
bool may_differ(const std::string& key);

/// [fleet.vehicle.NUMBERS]: the keys that those vehicles have otherwise than the scenario.
NamedTables own_tables();
/// fleet.vehicle.3.channel.prr is that of the uplink and that of the downlink.
std::vector<std::string> own_keys_meant_by(const std::string& key);

/// Fills FleetSettings::variants, and says in `own` all that these have otherwise. Throws
/// UsageError for numbers beyond the fleet, and for a key that a vehicle has twice.
void make_variants(Scenario& scenario, const ScenarioWith& with, const std::string& file);

}  // namespace tether
