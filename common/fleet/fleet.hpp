#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/scenario/section.hpp"

namespace tether {

/// [fleet]: several vehicles in one hall, each with its own loop. They are like the scenario's, but
/// for what [fleet.vehicle.NUMBERS] says of some. They touch each other, and their packets may
/// share a medium.
struct FleetSettings {
  /// Where on the lap of a closed path they begin: all where it does; evenly spread; at even places
  /// in an order by chance, each up to half of what is between two farther on.
  enum class Phases { none, even, random };
  /// The ticks of their sensors and timers: all at once, or each at a time of its own by chance.
  enum class Ticks { together, spread };

  int count = 1;
  Phases phases = Phases::even;
  double offset_x_m = 0.0;  ///< from a path to that of the next vehicle in a row
  double offset_y_m = 0.0;  ///< from a row of paths to the next
  int columns = 0;          ///< vehicles per row; 0: all in one row
  Ticks ticks = Ticks::spread;

  /// Values of [fleet.vehicle.NUMBERS], by the text NUMBERS (vehicle_numbers()) and by key.
  std::map<std::string, ScenarioValues> own;

  bool is_one() const { return count == 1; }

  /// Vehicles that are not as the others, and a scenario that is as theirs, but for what the fleet
  /// gives each: its name, its start, its place in the lap. No key: it follows from `own`.
  struct Variant {
    std::vector<int> numbers;  ///< ascending
    ScenarioValues own;        ///< all that their resolved scenario has otherwise
    std::shared_ptr<const Scenario> scenario;
  };
  std::vector<Variant> variants;

  // For one of the fleet's vehicles: not keys.
  int number = 1;           ///< from 1 on
  double tick_phase = 0.0;  ///< share of a period by which its ticks are later, in [0, 1)

  /// By how much the ticks of this vehicle are later.
  Duration tick_delay(Duration period) const {
    return from_seconds(to_seconds(period) * tick_phase);
  }
};

/// It refuses vehicles that would stand in each other, and what is wrong with one of them.
ScenarioSection fleet_section();

inline constexpr int kMostVehicles = 1000;

/// The scenario of each of the vehicles; of one alone, the scenario itself. Vehicles are called as
/// the scenario's, with their number: AGV1, AGV2, …; so their random streams are their own, and one
/// vehicle more changes no other's. A vehicle whose own path is open begins at its start, whatever
/// fleet.phases says. Random streams here: "<vehicle>/ticks", and "fleet/phases".
std::vector<Scenario> fleet_members(const Scenario& scenario);
/// The `members` for which `has` is true, such as has_localiser().
std::vector<Scenario> members_with(bool (*has)(const Scenario&),
                                   const std::vector<Scenario>& members);

}  // namespace tether
