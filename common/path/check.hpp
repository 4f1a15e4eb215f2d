#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/path/planned_path.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Demand of a path on the vehicle from one step to the next.
struct PathDemand {
  PathPoint point;
  double acceleration_mps2 = 0.0;
  double yaw_acceleration_radps2 = 0.0;
  double rim_speed_mps = 0.0;
  double rim_acceleration_mps2 = 0.0;
};

/// The largest demand that a part of the vehicle, or the controller, can meet.
struct PathLimit {
  const char* what;  ///< "a yaw rate"
  std::string unit;
  std::string key;  ///< the scenario key that sets it
  double value;
  std::function<double(const PathDemand&)> of;
};

/// Throws UsageError unless the vehicle can follow `path` within all limits and between walls at
/// ±half_extent_m. It names the waypoint's file and line, or `source`, the place, the limit's key
/// and its value. The vehicle may need more than the path asks of it to correct errors: a limit
/// that is just kept leaves nothing for that.
void check_path(const PlannedPath& path, const VehicleConfig& vehicle, double half_extent_m,
                const std::vector<PathLimit>& limits, const std::string& source);

}  // namespace tether
