#include "can_bridge/emulated/wheel_model.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

WheelModel::Config WheelModel::of(const VehicleConfig& vehicle) {
  Config config;
  const double radius_m = vehicle.wheel_radius_m;
  const double mass_kg =
      vehicle.chassis_mass_kg + vehicle.caster_mass_kg + 2.0 * vehicle.wheel_mass_kg;
  config.inertia_kgm2 =
      (mass_kg / 2.0 + vehicle.wheel_mass_kg / 2.0) * radius_m * radius_m;  // disc: m r²/2
  config.max_torque_Nm = vehicle.max_wheel_torque_Nm;
  config.gain_Nms = config.inertia_kgm2 / (4.0 * config.lag_s);
  return config;
}

void WheelModel::step(double target_radps, Duration dt) {
  constexpr Duration kLongest = std::chrono::milliseconds{1};
  for (Duration left = dt; left > Duration{0}; left -= kLongest) {
    substep(target_radps, to_seconds(std::min(left, kLongest)));
  }
}

void WheelModel::substep(double target_radps, double dt_s) {
  const double demand_Nm = std::clamp(config_.gain_Nms * (target_radps - speed_radps_),
                                      -config_.max_torque_Nm, config_.max_torque_Nm);
  torque_Nm_ += (demand_Nm - torque_Nm_) * dt_s / (config_.lag_s + dt_s);

  const double free_radps = speed_radps_ + torque_Nm_ / config_.inertia_kgm2 * dt_s;
  const double held_radps = config_.friction_Nm / config_.inertia_kgm2 * dt_s;
  // Friction takes speed away, but never turns the wheel back.
  speed_radps_ = std::copysign(std::max(std::abs(free_radps) - held_radps, 0.0), free_radps);
  angle_rad_ += speed_radps_ * dt_s;
}

}  // namespace tether
