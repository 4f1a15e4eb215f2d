#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {

// In the order of the resolved scenario. It stands above the rooms that have the sections; all
// programs are linked with it.
std::vector<ScenarioSection> scenario_sections() {
  return {run_section(),
          world_section(),
          vehicle_section(),
          sensor_section(),
          path_section({controller_path_limits, vehicle_path_limits, can_path_limits}),
          controller_section(),
          actuator_section(),
          can_section(),
          channel_section()};
}

}  // namespace tether
