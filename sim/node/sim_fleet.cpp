#include "sim/node/sim_fleet.hpp"

#include <algorithm>
#include <memory>

#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

SimFleet::SimFleet(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus) {
  if (members.size() > 1) {
    traffic_.emplace(step_of(members.front().get<WorldSettings>()), std::max(kStart, loop.now()));
  }
  for (const Scenario& member : members) {
    nodes_.add(std::make_unique<SimNode>(member, loop, bus, traffic_ ? &*traffic_ : nullptr));
  }
}

}  // namespace tether
