#pragma once

namespace tether {

/// Maximum demand of a planned path on the vehicle. It is slower than speed_mps where another limit
/// says so.
struct PathLimits {
  double speed_mps = 1.5;  ///< cruise
  double max_acceleration_mps2 = 0.5;
  double max_deceleration_mps2 = 0.5;
  double max_lateral_acceleration_mps2 = 1.0;  ///< v²·|κ|, with the curvature κ
  double max_yaw_rate_radps = 1.0;             ///< v·|κ|
  double max_yaw_acceleration_radps2 = 1.0;
};

}  // namespace tether
