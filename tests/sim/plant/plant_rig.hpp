#pragma once

#include <chrono>
#include <cmath>

#include "common/vehicle/vehicle_settings.hpp"
#include "sim/plant/plant.hpp"

// Driving a plant step by step.

namespace tether::test {

inline constexpr Duration kStep = std::chrono::milliseconds(1);
inline constexpr double kStep_s = 1e-3;
inline constexpr WorldSettings kOpenFloor{.half_extent_m = 1e4};

inline WheelSpeeds wheels(double v_mps, double omega_radps) {
  return to_wheel_speeds({v_mps, omega_radps}, VehicleConfig{}.track_m);
}

inline void run(Plant& vehicle, double seconds) {
  const long steps = std::lround(seconds / kStep_s);
  for (long i = 0; i < steps; ++i) vehicle.step();
}

}  // namespace tether::test
