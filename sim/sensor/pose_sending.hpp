#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {

/// Which of the measured poses are sent with sensor.send = "changed": send-on-delta (Miskowicz:
/// Send-On-Delta Concept: An Event-Based Data Reporting Strategy. Sensors 6, 2006). A pose says
/// nothing of speed, so until the next one the receiver can but hold it; one is sent if it is
/// farther than sensor.send_delta_m, or turned by more than sensor.send_delta_rad, from the last
/// one that was, and else so early that no two are further apart than sensor.send_max_age_s. What
/// became of those that were sent it does not know: a lost one is made good for by the next.
class PoseSending {
 public:
  explicit PoseSending(const SensorSettings& settings)
      : delta_m_(settings.send_delta_m),
        delta_rad_(settings.send_delta_rad),
        max_age_(from_seconds(settings.send_max_age_s)),
        period_(from_seconds(1.0 / settings.rate_hz)) {}

  /// Whether the pose that was measured at `now`, which goes up, is to be sent; then it counts as
  /// sent.
  bool is_due(Instant now, const Pose2& measured) {
    ++sampled_;
    if (last_ && now + period_ - last_->at <= max_age_ && !differs(measured)) return false;
    last_ = {measured, now};
    ++sent_;
    return true;
  }

  std::int64_t sampled() const { return sampled_; }
  std::int64_t sent() const { return sent_; }

 private:
  struct Sent {
    Pose2 pose;
    Instant at;
  };
  bool differs(const Pose2& pose) const {
    return std::hypot(pose.x_m - last_->pose.x_m, pose.y_m - last_->pose.y_m) > delta_m_ ||
           std::abs(wrap_angle(pose.yaw_rad - last_->pose.yaw_rad)) > delta_rad_;
  }

  double delta_m_, delta_rad_;
  Duration max_age_, period_;
  std::optional<Sent> last_;
  std::int64_t sampled_ = 0, sent_ = 0;
};

}  // namespace tether
