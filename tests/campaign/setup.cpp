#include "tests/campaign/setup.hpp"

#include "tests/support/source_dir.hpp"

namespace tether::campaign {

Setup load_setup() {
  const Scenario scenario = load_scenario(in_source("/scenarios/hil_vcan.toml"),
                                          {"run.lead_s=0", "can.wheels=model", "can.arm=never"});
  return {scenario, load_drivetrain(scenario.get<CanSettings>().drivetrain_file)};
}

DrivetrainConfig drivetrain_of(const Setup& setup, const Trial& trial) {
  DrivetrainConfig drivetrain = setup.drivetrain;
  auto& config = std::get<Cia402Config>(drivetrain);
  config.emulated_brake = trial.brake;
  config.emulated_coasting_radps2 =
      trial.coast_mps2 / setup.settings.get<VehicleSettings>().wheel_radius_m;
  return drivetrain;
}

BridgeSettings settings_of(const Setup& setup, const Trial& trial) {
  BridgeSettings settings = setup.settings;
  auto& can = settings.get<CanSettings>();
  can.max_speed_mps = can.max_reverse_mps = trial.max_speed_mps;
  can.max_yaw_rate_radps = trial.max_yaw_rate_radps;
  can.max_deceleration_mps2 = trial.deceleration_mps2;
  can.max_acceleration_mps2 = trial.deceleration_mps2;
  can.max_yaw_deceleration_radps2 = trial.yaw_deceleration_radps2;
  can.max_yaw_acceleration_radps2 = trial.yaw_deceleration_radps2;
  can.max_blind_s = trial.max_blind_s;
  can.max_blind_m = trial.max_blind_m;
  settings.get<RunSettings>().report_period_s = 1000.0;
  settings.get<ActuatorSettings>().policy = trial.plans ? "horizon" : "hold";
  return settings;
}

Limits limits_of(const BridgeSettings& settings) {
  const auto& can = settings.get<CanSettings>();
  Limits limits;
  limits.cycle = from_seconds(can.cycle_ms * 1e-3);
  limits.stale = from_seconds(can.stale_ms * 1e-3);
  limits.disarm = from_seconds(can.disarm_ms * 1e-3);
  limits.max_blind = from_seconds(can.max_blind_s);
  limits.max_blind_m = can.max_blind_m;
  limits.track_m = settings.get<VehicleSettings>().track_m;
  limits.max_speed_mps = can.max_speed_mps;
  limits.max_yaw_rate_radps = can.max_yaw_rate_radps;
  limits.acceleration_mps2 = can.max_acceleration_mps2;
  limits.yaw_acceleration_radps2 = can.max_yaw_acceleration_radps2;
  limits.deceleration_mps2 = can.max_deceleration_mps2;
  limits.yaw_deceleration_radps2 = can.max_yaw_deceleration_radps2;
  return limits;
}

}  // namespace tether::campaign
