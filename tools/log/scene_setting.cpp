#include "tools/log/scene_setting.hpp"

#include <algorithm>
#include <cmath>

#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"

namespace tether {
namespace {

/// Moving shapes as in the simulator, within 50 ms of each start and each stop.
std::vector<MovingShape> moving_shapes(const Scenario& scenario, double duration_s) {
  constexpr double kStep_s = 0.05;
  MovingObstacles obstacles(scenario.get<Surroundings>(), scenario.get<RunSettings>().seed);
  std::vector<MovingShape> all;
  for (const Shape& shape : obstacles.at(0.0)) {
    all.push_back({shape, {{0.0, shape.pose.x_m, shape.pose.y_m}}});
  }
  if (all.empty()) return all;
  std::vector<Shape> before = obstacles.at(0.0);
  double before_s = 0.0;
  std::size_t count = all.size();
  for (double i = 1.0; before_s < duration_s && count < kMostPlaces; ++i) {
    const double t_s = std::min(i * kStep_s, duration_s);
    const std::vector<Shape>& now = obstacles.at(t_s);
    for (std::size_t k = 0; k < now.size(); ++k) {
      const bool as_before = now[k].vx_mps == before[k].vx_mps && now[k].vy_mps == before[k].vy_mps;
      if (as_before && t_s < duration_s) continue;
      const Pose2& from = before[k].pose;
      if (!as_before) all[k].places.push_back({before_s, from.x_m, from.y_m});
      all[k].places.push_back({t_s, now[k].pose.x_m, now[k].pose.y_m});
      count += 2;
    }
    before = now;
    before_s = t_s;
  }
  return all;
}

}  // namespace

Pose2 MovingShape::at(double t_s) const {
  const auto next = std::upper_bound(places.begin(), places.end(), t_s,
                                     [](double t, const Place& place) { return t < place.t_s; });
  const Place& b = next == places.end() ? places.back() : *next;
  const Place& a = next == places.begin() ? b : *(next - 1);
  const double share = b.t_s > a.t_s ? (t_s - a.t_s) / (b.t_s - a.t_s) : 0.0;
  return {std::lerp(a.x_m, b.x_m, share), std::lerp(a.y_m, b.y_m, share), shape.pose.yaw_rad};
}

SceneSetting scene_setting(const Scenario& scenario) {
  SceneSetting setting;
  setting.half_extent_m = scenario.get<WorldSettings>().half_extent_m;
  setting.obstacles = obstacle_shapes(scenario.get<Surroundings>());
  setting.vehicle = scenario.get<VehicleSettings>();
  const double duration_s = scenario.get<RunSettings>().duration_s;
  const auto path = make_path(scenario.get<PathSettings>());
  const double steps = std::clamp(std::ceil(duration_s / 0.1), 1.0, kMostPathPoints - 1.0);
  for (double i = 0.0; i <= steps; ++i) {
    const double t_s = duration_s * i / steps;
    setting.path.push_back({t_s, path->at(t_s)});
  }
  setting.moving = moving_shapes(scenario, duration_s);
  return setting;
}

}  // namespace tether
