#include <fmt/format.h>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/actuator/actuator_policy.hpp"
#include "common/actuator/actuator_settings.hpp"
#include "common/base/errors.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {
namespace {

/// A vehicle that stops between two commands was not meant: the timeout is longer than the period.
void check_timeout(const Scenario& scenario, const std::string& file) {
  const auto& actuator = scenario.get<ActuatorSettings>();
  const auto& controller = scenario.get<ControllerSettings>();
  const ActuatorPolicy& policy = kind_of(actuator);
  if (policy.after_timeout == nullptr || policy.takes_plans) return;
  const bool by_timer = controller.trigger == ControllerSettings::Trigger::timer;
  const double rate_hz = by_timer ? controller.rate_hz : scenario.get<SensorSettings>().rate_hz;
  if (actuator.timeout_s * rate_hz >= 1.0) return;
  throw UsageError(fmt::format(
      "{}: actuator.timeout_s = {} is below the time between two commands, {} s ({} = {}): the "
      "vehicle would stop before each of them",
      file, actuator.timeout_s, 1.0 / rate_hz, by_timer ? "controller.rate_hz" : "sensor.rate_hz",
      rate_hz));
}

}  // namespace

// In the order of the resolved scenario. It stands above the rooms that have the sections; all
// programs are linked with it.
std::vector<ScenarioSection> scenario_sections() {
  ScenarioSection actuator = actuator_section();
  actuator.check = check_timeout;
  return {run_section(),
          world_section(),
          vehicle_section(),
          sensor_section(),
          path_section({controller_path_limits, vehicle_path_limits, can_path_limits}),
          controller_section(),
          actuator,
          can_section(),
          channel_section()};
}

}  // namespace tether
