#include "sim/node/sim_fleet.hpp"

#include <memory>

#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

SimFleet::SimFleet(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus) {
  if (members.size() > 1) {
    traffic_.emplace(step_of(members.front().get<WorldSettings>()));
    // Before the vehicles' own events of the same instant.
    loop.every(kStart, Traffic::kHorizon, Priority::physics,
               [this](Instant now) { traffic_->look(now); });
  }
  for (const Scenario& member : members) {
    nodes_.add(std::make_unique<SimNode>(member, loop, bus, traffic_ ? &*traffic_ : nullptr));
  }
}

}  // namespace tether
