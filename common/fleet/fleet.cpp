#include "common/fleet/fleet.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>

#include "common/base/random.hpp"
#include "common/fleet/own_keys.hpp"
#include "common/path/kinds.hpp"
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

/// A variant with what all vehicles share as the scenario has it now: sweeps change the seed.
Scenario up_to_date(const Scenario& variant, const Scenario& scenario) {
  Scenario one = variant;
  const auto& sections = scenario.schema().sections();
  for (std::size_t i = 0; i < sections.size(); ++i) {
    const auto& keys = sections[i].keys;
    if (std::none_of(keys.begin(), keys.end(),
                     [](const auto& key) { return may_differ(key.name); }))
      one.take_section(scenario, i);
  }
  return one;
}

/// Each vehicle's scenario, but for what the fleet gives it.
std::vector<Scenario> before_their_places(const Scenario& scenario) {
  const auto& fleet = scenario.get<FleetSettings>();
  Scenario like_most = scenario;
  like_most.get<FleetSettings>().own.clear();
  like_most.get<FleetSettings>().variants.clear();
  std::vector<Scenario> all(static_cast<std::size_t>(fleet.count), like_most);
  for (const FleetSettings::Variant& variant : fleet.variants) {
    const Scenario one = up_to_date(*variant.scenario, like_most);
    for (const int number : variant.numbers) all[static_cast<std::size_t>(number - 1)] = one;
  }
  return all;
}

bool is_open(const PathSettings& settings) {
  const PathKind& kind = kind_of(settings);
  return kind.curve != nullptr && !kind.curve(settings)->is_closed();
}

/// Makes one of them the fleet's vehicle of this number, from 0 on.
void take_place(Scenario& one, int index, double phase) {
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
  if (fleet.ticks == FleetSettings::Ticks::spread) {
    RandomEngine random = random_stream(one.get<RunSettings>().seed, vehicle.name + "/ticks");
    fleet.tick_phase = uniform_01(random);
  }
  fleet.count = 1;
  fleet.number = index + 1;
}

}  // namespace

std::vector<Scenario> fleet_members(const Scenario& scenario) {
  const auto& fleet = scenario.get<FleetSettings>();
  if (fleet.is_one()) return {scenario};
  std::vector<double> begins = phases(fleet, scenario.get<RunSettings>().seed);
  for (const FleetSettings::Variant& variant : fleet.variants) {
    if (!is_open(variant.scenario->get<PathSettings>())) continue;
    for (const int number : variant.numbers) begins[static_cast<std::size_t>(number - 1)] = 0.0;
  }
  std::vector<Scenario> members = before_their_places(scenario);
  double fastest_mps = 0.0;
  for (std::size_t i = 0; i < members.size(); ++i) {
    take_place(members[i], static_cast<int>(i), begins[i]);
    fastest_mps = std::max(fastest_mps, members[i].get<VehicleSettings>().max_wheel_speed_mps);
  }
  for (Scenario& one : members) one.get<Surroundings>().vehicles_mps = fastest_mps;
  return members;
}

std::vector<Scenario> members_with(bool (*has)(const Scenario&),
                                   const std::vector<Scenario>& members) {
  std::vector<Scenario> those;
  std::copy_if(members.begin(), members.end(), std::back_inserter(those), has);
  return those;
}

}  // namespace tether
