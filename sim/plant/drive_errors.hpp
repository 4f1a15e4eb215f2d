#pragma once

#include "common/scenario/scenario.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// Turns twists into rim speeds as a real drive does: its wheels and its track are not quite what
/// it believes, and it lags. With all errors zero the result is that of to_wheel_speeds() to the
/// bit.
/// - vehicle.radius_error: the wheels are larger than the drive believes by this share, so that
///   rims are as much faster than they should be;
/// - vehicle.track_error: the drive believes in a track that is wider by this share;
/// - vehicle.actuator_lag_ms: rim speeds follow through a low-pass of first order (backward Euler).
class DriveErrors {
 public:
  explicit DriveErrors(const VehicleSettings& vehicle)
      : believed_track_m_(vehicle.track_m * (1.0 + vehicle.track_error)),
        larger_(1.0 + vehicle.radius_error),
        lag_s_(vehicle.actuator_lag_ms * 1e-3) {}

  /// Whether the wheels' setpoints go on changing after the twist has changed.
  bool lags() const { return lag_s_ > 0.0; }

  /// Setpoints of the wheels for a step of `dt_s` in which `twist` is in force.
  WheelSpeeds step(const Twist& twist, double dt_s) {
    WheelSpeeds rim = to_wheel_speeds(twist, believed_track_m_);
    rim = {rim.left_mps * larger_, rim.right_mps * larger_};
    if (lag_s_ <= 0.0) return rim;
    const double share = dt_s / (lag_s_ + dt_s);
    lagging_.left_mps += share * (rim.left_mps - lagging_.left_mps);
    lagging_.right_mps += share * (rim.right_mps - lagging_.right_mps);
    return lagging_;
  }

 private:
  double believed_track_m_;
  double larger_;
  double lag_s_;
  WheelSpeeds lagging_;
};

}  // namespace tether
