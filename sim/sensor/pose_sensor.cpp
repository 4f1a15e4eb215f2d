#include "sim/sensor/pose_sensor.hpp"

#include <cmath>

namespace tether {

PoseSensor::PoseSensor(const SensorSettings& config, std::uint64_t seed, const std::string& vehicle)
    : config_(config),
      random_(random_stream(seed, vehicle + "/sensor/pose")),
      x_noise_(config.noise_correlation_s, config.rate_hz),
      y_noise_(x_noise_),
      yaw_noise_(x_noise_),
      drift_random_(random_stream(seed, vehicle + "/sensor/drift")),
      jumps_(config, random_stream(seed, vehicle + "/sensor/jumps")),
      dropouts_(config, random_stream(seed, vehicle + "/sensor/dropouts")) {}

std::optional<Pose2> PoseSensor::measure(const Pose2& truth) {
  walk();
  const double t_s = static_cast<double>(count_++) / config_.rate_hz;
  const double dx_m = config_.position_noise_m * x_noise_.next(normal_(random_));
  const double dy_m = config_.position_noise_m * y_noise_.next(normal_(random_));
  const double dyaw_rad = config_.yaw_noise_rad * yaw_noise_.next(normal_(random_));
  const Pose2 jump = jumps_.at(t_s);
  if (dropouts_.at(t_s)) return std::nullopt;
  return Pose2{truth.x_m + drift_.x_m + dx_m + (config_.bias_x_m + jump.x_m),
               truth.y_m + drift_.y_m + dy_m + (config_.bias_y_m + jump.y_m),
               wrap_angle(truth.yaw_rad + drift_.yaw_rad + dyaw_rad +
                          (config_.bias_yaw_rad + jump.yaw_rad))};
}

void PoseSensor::walk() {
  if (count_ == 0) return;
  const double root_s = std::sqrt(1.0 / config_.rate_hz);
  drift_.x_m += config_.position_drift_mpsqrts * root_s * drift_normal_(drift_random_);
  drift_.y_m += config_.position_drift_mpsqrts * root_s * drift_normal_(drift_random_);
  drift_.yaw_rad += config_.yaw_drift_radpsqrts * root_s * drift_normal_(drift_random_);
}

}  // namespace tether
