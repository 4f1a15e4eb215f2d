#pragma once

#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/runs/fleet_observer.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {

/// Result of a run; of a fleet, what it did as a whole, and each vehicle by its name; in words,
/// the worst few.
std::string to_json(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary);
std::string to_text(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary);

/// How a fleet stands at `now`, in two lines: ε in the mean and of the worst vehicle, up to now;
/// how many are lost, and collisions. Empty for a vehicle that is alone.
std::vector<std::string> fleet_now(const FleetObserver& fleet, Instant now);

}  // namespace tether
