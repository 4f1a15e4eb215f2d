#pragma once

#include <string>

#include "common/scenario/scenario.hpp"
#include "tools/runs/fleet_observer.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {

/// What a run tells; of a fleet, what it did as a whole, and each vehicle by its name; in words,
/// the worst few.
std::string to_json(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary);
std::string to_text(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary);

}  // namespace tether
