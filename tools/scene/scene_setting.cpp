#include "tools/scene/scene_setting.hpp"

#include <algorithm>
#include <cmath>

#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

SceneSetting scene_setting(const Scenario& scenario) {
  SceneSetting setting;
  setting.half_extent_m = scenario.get<WorldSettings>().half_extent_m;
  setting.vehicle = scenario.get<VehicleSettings>();
  const double duration_s = scenario.get<RunSettings>().duration_s;
  const auto path = make_path(scenario.get<PathSettings>());
  const double steps = std::clamp(std::ceil(duration_s / 0.1), 1.0, kMostPathPoints - 1.0);
  for (double i = 0.0; i <= steps; ++i) {
    const double t_s = duration_s * i / steps;
    setting.path.push_back({t_s, path->at(t_s)});
  }
  return setting;
}

}  // namespace tether
