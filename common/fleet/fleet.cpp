#include "common/fleet/fleet.hpp"

#include <algorithm>
#include <numeric>

#include "common/base/random.hpp"
#include "common/base/shuffle.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"

namespace tether {
namespace {

/// Where each of the vehicles begins, as a share of a lap.
std::vector<double> phases(const FleetSettings& fleet, std::uint64_t seed) {
  const auto count = static_cast<std::size_t>(fleet.count);
  std::vector<double> phases(count, 0.0);
  if (fleet.phases == FleetSettings::Phases::none) return phases;
  std::vector<std::size_t> places(count);
  std::iota(places.begin(), places.end(), std::size_t{0});
  RandomEngine random = random_stream(seed, "fleet/phases");
  const bool by_chance = fleet.phases == FleetSettings::Phases::random;
  if (by_chance) shuffle(places, random);
  for (std::size_t i = 0; i < count; ++i) {
    const double farther = by_chance ? 0.5 * uniform_01(random) : 0.0;
    phases[i] = (static_cast<double>(places[i]) + farther) / static_cast<double>(count);
  }
  return phases;
}

Scenario member(const Scenario& scenario, int index, double phase) {
  Scenario one = scenario;
  auto& fleet = one.get<FleetSettings>();
  const int columns = fleet.columns > 0 ? fleet.columns : fleet.count;
  auto& vehicle = one.get<VehicleSettings>();
  vehicle.name += std::to_string(index + 1);
  auto& path = one.get<PathSettings>();
  path.phase += phase;
  if (path.phase >= 1.0) path.phase -= 1.0;
  const int column = index % columns, row = index / columns;
  path.offset_x_m += fleet.offset_x_m * column;
  path.offset_y_m += fleet.offset_y_m * row;
  const Pose2 start = start_on(path, vehicle);
  vehicle.start_x_m = start.x_m;
  vehicle.start_y_m = start.y_m;
  vehicle.start_yaw_rad = start.yaw_rad;
  one.get<Surroundings>().vehicles_mps = vehicle.max_wheel_speed_mps;
  if (fleet.ticks == FleetSettings::Ticks::spread) {
    RandomEngine random = random_stream(one.get<RunSettings>().seed, vehicle.name + "/ticks");
    fleet.tick_phase = uniform_01(random);
  }
  fleet.count = 1;
  fleet.number = index + 1;
  return one;
}

}  // namespace

std::vector<Scenario> fleet_members(const Scenario& scenario) {
  const auto& fleet = scenario.get<FleetSettings>();
  if (fleet.is_one()) return {scenario};
  const std::vector<double> begins = phases(fleet, scenario.get<RunSettings>().seed);
  std::vector<Scenario> members;
  for (int i = 0; i < fleet.count; ++i) {
    members.push_back(member(scenario, i, begins[static_cast<std::size_t>(i)]));
  }
  return members;
}

}  // namespace tether
