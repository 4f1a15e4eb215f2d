#include "onboard/autonomy/autonomy_section.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "onboard/autonomy/swept_way.hpp"

namespace tether {
namespace {

using Autonomy = AutonomySettings;

constexpr Range kTime{0.01, 1000.0, false};

/// The wheels must be able to follow the setpoints: else the vehicle stops behind its
/// stopping field's end.
void check_brakes(const Scenario& scenario, const std::string& file) {
  const auto& autonomy = scenario.get<Autonomy>();
  const auto& vehicle = scenario.get<VehicleSettings>();
  const double rim_mps2 =
      autonomy.deceleration_mps2 + autonomy.yaw_acceleration_radps2 * 0.5 * vehicle.track_m;
  if (rim_mps2 > vehicle.max_wheel_acceleration_mps2) {
    throw UsageError(
        fmt::format("{}: autonomy.deceleration_mps2 = {} and autonomy.yaw_acceleration_radps2 = {} "
                    "ask for {:g} "
                    "m/s^2 of a rim, more than vehicle.max_wheel_acceleration_mps2 = {}",
                    file, autonomy.deceleration_mps2, autonomy.yaw_acceleration_radps2, rim_mps2,
                    vehicle.max_wheel_acceleration_mps2));
  }
  const double least_radps2 = autonomy.deceleration_mps2 / outline_of(vehicle).reach_m();
  if (autonomy.yaw_acceleration_radps2 < least_radps2) {
    throw UsageError(fmt::format(
        "{}: autonomy.yaw_acceleration_radps2 = {} stops turns later than "
        "autonomy.deceleration_mps2 = {} says: at least {:.3f}",
        file, autonomy.yaw_acceleration_radps2, autonomy.deceleration_mps2, least_radps2));
  }
}

void check(const Scenario& scenario, const std::string& file) {
  if (!scenario.get<Autonomy>().enabled) return;
  check_brakes(scenario, file);
}

}  // namespace

ScenarioSection autonomy_section() {
  KeyTable<Autonomy> t("autonomy.");
  t.boolean("enabled", &Autonomy::enabled,
            "the vehicle drives by itself, stops for obstacles and asks for a remote driver");
  t.number("rate_hz", &Autonomy::rate_hz, {5.0, 1000.0, false}, "setpoints per second");
  t.number("deceleration_mps2", &Autonomy::deceleration_mps2, {0.01, 100.0, false},
           "deceleration a of the stopping field v^2/2a + v reaction + margin, and limit of "
           "setpoints' changes");
  t.number("yaw_acceleration_radps2", &Autonomy::yaw_acceleration_radps2, {0.01, 100.0, false},
           "yaw acceleration limit of setpoints");
  t.number("reaction_s", &Autonomy::reaction_s, {0.02, 10.0, false},
           "reaction time of the stopping field; older scans are ignored");
  t.number("margin_m", &Autonomy::margin_m, {0.01, 10.0, false},
           "margin of the stopping field ahead of the vehicle");
  t.number("side_margin_m", &Autonomy::side_margin_m, {0.0, 10.0, false},
           "margin of the stopping field to each side");
  t.number("wait_s", &Autonomy::wait_s, kTime,
           "time in a protective stop before a remote driver is requested");
  t.number("clear_for_s", &Autonomy::clear_for_s, kTime,
           "time that the way must be free before the vehicle drives on by itself");
  t.number("pose_timeout_s", &Autonomy::pose_timeout_s, kTime,
           "time without a pose after which localisation counts as lost");
  t.number("remote_timeout_s", &Autonomy::remote_timeout_s, kTime,
           "time without a command after which the remote driver counts as gone");
  t.number("remote_max_age_s", &Autonomy::remote_max_age_s, kTime,
           "maximum age of the report that a remote driver's command names");
  t.number("remote_speed_mps", &Autonomy::remote_speed_mps, {0.01, 10.0, false},
           "speed limit while driven remotely");
  ScenarioSection section{.defaults = Autonomy{}, .keys = t.take()};
  for (const ScenarioKey& key : section.keys) {
    if (key.name != "autonomy.enabled") {
      section.switched.push_back({key.name, {"autonomy.enabled"}, false});
    }
  }
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    return key.name == "autonomy.enabled" && !scenario.get<Autonomy>().enabled;
  };
  section.check = check;
  return section;
}

}  // namespace tether
