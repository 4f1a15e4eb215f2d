#include "sim/plant/plant.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "common/base/random.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/plant/kinematic_vehicle.hpp"
#include "sim/plant/ode_vehicle.hpp"

namespace tether {

Plant::Steps Plant::take(std::int64_t most, Instant from) {
  Steps steps;
  for (; steps.taken < most; ++steps.taken) {
    set_time(to_seconds(from + step_ * steps.taken));
    step();
    if (wall_contact()) ++steps.in_contact;
  }
  return steps;
}

void require_plant(bool good, const char* what) {
  if (!good) throw std::invalid_argument(std::string("vehicle or world: ") + what);
}

void check_start_and_step(const VehicleConfig& vehicle, const WorldSettings& world, double step_s) {
  require_plant(is_usable(Pose2{vehicle.start_x_m, vehicle.start_y_m, vehicle.start_yaw_rad}),
                "the start pose must be finite");
  require_plant(
      std::max(std::abs(vehicle.start_x_m), std::abs(vehicle.start_y_m)) < world.half_extent_m,
      "the start must lie between the walls");
  require_plant(step_s > 0, "the physics step must be positive");
}

std::unique_ptr<Plant> make_plant(const VehicleSettings& vehicle, const WorldSettings& world,
                                  Duration step, std::uint64_t seed,
                                  const Surroundings& surroundings) {
  if (vehicle.plant == VehicleSettings::Plant::kinematic) {
    return std::make_unique<KinematicVehicle>(vehicle, world, step, surroundings, seed);
  }
  return std::make_unique<OdeVehicle>(
      vehicle, world, step, random_stream(seed, vehicle.name + "/bumps"), surroundings, seed);
}

}  // namespace tether
