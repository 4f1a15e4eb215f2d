#pragma once

#include <optional>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// A point of the path, and when the vehicle should be there.
struct TimedPoint {
  double t_s = 0.0;
  PathPoint point;
};

/// What a scenario says of what there is to be seen. Messages say only where the vehicle is.
struct SceneSetting {
  double half_extent_m = 0.0;            ///< walls at ± this; 0: not known
  std::optional<VehicleConfig> vehicle;  ///< its shape; none: not known
  std::vector<TimedPoint> path;          ///< in order of time
};

/// At most this many points of a path, every 0.1 s or, of a long run, as often as that allows.
inline constexpr std::size_t kMostPathPoints = 2000;

/// Plans the path from t = 0 to run.duration_s. Throws UsageError as make_path() does.
SceneSetting scene_setting(const Scenario& scenario);

}  // namespace tether
