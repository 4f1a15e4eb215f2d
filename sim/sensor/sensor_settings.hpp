#pragma once

#include <cstdint>

#include "common/scenario/section.hpp"

namespace tether {

/// [sensor]: what turns truth into poses, and what the wheels' encoders say.
struct SensorSettings {
  double rate_hz = 20.0;
  double position_noise_m = 0.0;  ///< standard deviation, each axis
  double yaw_noise_rad = 0.0;     ///< standard deviation
  /// Correlation time of both noises; 0: white (gauss_markov.hpp).
  double noise_correlation_s = 0.0;
  // Always the same: of a map that is not where the world's origin is.
  double bias_x_m = 0.0;
  double bias_y_m = 0.0;
  double bias_yaw_rad = 0.0;
  double position_drift_mpsqrts = 0.0;  ///< random walk of each axis, as odometry has it:
  double yaw_drift_radpsqrts = 0.0;     ///< standard deviation after 1 s; it grows with √t
  // The localisation takes another place for the right one (localisation_jumps.hpp).
  double jumps_per_min = 0.0;
  double jump_m = 0.5;    ///< standard deviation of a jump, each axis
  double jump_rad = 0.1;  ///< standard deviation of a jump's yaw
  double jump_s = 0.0;    ///< until it is right again; 0: until the next jump
  // No poses for a while (dropouts.hpp).
  double dropouts_per_min = 0.0;
  double dropout_s = 1.0;   ///< mean duration
  double latency_ms = 0.0;  ///< from measurement to publication
  /// Which poses are sent: all, or those that say something new (pose_sending.hpp).
  enum class Send { always, changed };
  Send send = Send::always;
  double send_delta_m = 0.1;       ///< by how much a pose is off the last one sent
  double send_delta_rad = 0.1;     ///< the same for the yaw
  double send_max_age_s = 0.4;     ///< the longest time between two
  double odometry_rate_hz = 0.0;   ///< 0: none (wheel_odometry.hpp)
  std::int64_t encoder_ticks = 0;  ///< a wheel's turn; 0: its angle is read exactly
};

ScenarioSection sensor_section();

}  // namespace tether
