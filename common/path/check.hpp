#pragma once

#include <string>

#include "common/path/planned_path.hpp"
#include "common/scenario/scenario.hpp"

namespace tether {

/// Throws UsageError unless the scenario's vehicle can follow `path` between its walls: outline,
/// wheels, tyres, the limits of the control law's output and, with drives on CAN, the bridge's. It
/// names the waypoint's file and line, or `source`, the place, the limit's key and its value. The
/// vehicle may need more than the path asks of it to correct errors: a limit that is just kept
/// leaves nothing for that.
void check_path(const PlannedPath& path, const Scenario& scenario, const std::string& source);

}  // namespace tether
