#include "controller/laws/tracking_feedback.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

/// The share of the acceleration that catching up may use. The rest is for the path's own changes
/// of speed, and for turning.
constexpr double kCatchUpShare = 0.9;
/// Where the path rests and the vehicle does not, the vehicle turns as if the path had this speed.
constexpr double kSlowest_mps = 1.0;
constexpr double kOnPath_m = 0.01;
constexpr double kOnPath_rad = 0.01;

}  // namespace

TrackingFeedback::TrackingFeedback(const ControllerSettings& config, double max_acceleration_mps2)
    : gains_(config.tracking),
      look_ahead_m_(gains_.k_theta / gains_.k_y),
      acceleration_mps2_(kCatchUpShare * max_acceleration_mps2),
      linear_m_(acceleration_mps2_ / (gains_.k_x * gains_.k_x)),
      max_v_mps_(config.v.limit),
      max_omega_radps_(config.omega.limit) {}

double TrackingFeedback::closing_speed(double x_e_m) const {
  const double distance_m = std::abs(x_e_m);
  if (distance_m <= linear_m_) return gains_.k_x * x_e_m;
  return std::copysign(std::sqrt(2.0 * acceleration_mps2_ * (distance_m - 0.5 * linear_m_)), x_e_m);
}

Twist TrackingFeedback::command(const Pose2& pose, const Heading& heading,
                                const PathPoint& reference) const {
  const auto [c, s] = heading;
  const double dx_m = reference.x_m - pose.x_m, dy_m = reference.y_m - pose.y_m;
  const double x_e = c * dx_m + s * dy_m;
  const double y_e = c * dy_m - s * dx_m;
  const double theta_e = reference.yaw_rad - pose.yaw_rad;
  const auto [sin_e, cos_e] = sin_cos(theta_e);

  Twist u;
  u.v_mps = std::clamp(reference.v_mps * cos_e + closing_speed(x_e), -max_v_mps_, max_v_mps_);
  const double alpha =
      direction_of(y_e + look_ahead_m_ * sin_e, look_ahead_m_ * cos_e + std::max(x_e, 0.0));
  // The path's speed, not v: when the vehicle catches up at three times the path's speed, the gain
  // would ask for more than the wheels can do.
  const double speed_mps = std::max(reference.v_mps, std::min(std::abs(u.v_mps), kSlowest_mps));
  u.omega_radps = std::clamp(reference.omega_radps + speed_mps * gains_.k_theta * alpha,
                             -max_omega_radps_, max_omega_radps_);
  // The path's own speed is never taken away: it was checked against the vehicle.
  const double lateral_mps2 = std::abs(u.v_mps * u.omega_radps);
  if (lateral_mps2 > gains_.max_lateral_mps2 && std::abs(u.v_mps) > reference.v_mps) {
    const double slower_mps = gains_.max_lateral_mps2 / std::abs(u.omega_radps);
    u.v_mps = std::copysign(std::max(slower_mps, reference.v_mps), u.v_mps);
  }
  return u;
}

bool is_on_path(const Pose2& pose, const PathPoint& reference) {
  const double dx_m = reference.x_m - pose.x_m, dy_m = reference.y_m - pose.y_m;
  return dx_m * dx_m + dy_m * dy_m < kOnPath_m * kOnPath_m &&
         std::abs(wrap_angle(reference.yaw_rad - pose.yaw_rad)) < kOnPath_rad;
}

LawErrors errors_to(const Pose2& pose, const PathPoint& reference) {
  const double dx_m = reference.x_m - pose.x_m, dy_m = reference.y_m - pose.y_m;
  const double distance_m = std::hypot(dx_m, dy_m);
  const double heading_rad =
      distance_m > 0.0 ? wrap_angle(std::atan2(dy_m, dx_m) - pose.yaw_rad) : 0.0;
  return {heading_rad, distance_m};
}

}  // namespace tether
