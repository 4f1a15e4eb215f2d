#pragma once

#include "common/scenario/section.hpp"

namespace tether {

/// [sensor]: what turns truth into poses.
struct SensorSettings {
  double rate_hz = 20.0;
  double position_noise_m = 0.0;        ///< standard deviation, each axis, white
  double yaw_noise_rad = 0.0;           ///< standard deviation, white
  double position_drift_mpsqrts = 0.0;  ///< random walk of each axis, as odometry has it:
  double yaw_drift_radpsqrts = 0.0;     ///< standard deviation after 1 s; it grows with √t
  double latency_ms = 0.0;              ///< from measurement to publication
};

ScenarioSection sensor_section();

}  // namespace tether
