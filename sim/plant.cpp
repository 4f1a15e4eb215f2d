#include "sim/plant.hpp"

#include "sim/kinematic_vehicle.hpp"
#include "sim/ode_vehicle.hpp"

namespace tether {

std::unique_ptr<Plant> make_plant(const Scenario::Vehicle& vehicle, const WorldConfig& world,
                                  Duration step) {
  if (vehicle.plant == Scenario::Vehicle::Plant::kinematic) {
    return std::make_unique<KinematicVehicle>(vehicle, world, step);
  }
  return std::make_unique<OdeVehicle>(vehicle, world, step);
}

}  // namespace tether
