#include "can_bridge/safety/odometry.hpp"

#include <algorithm>
#include <cmath>

#include "common/vehicle/diff_drive.hpp"

namespace tether {
namespace {

/// sin(x)/x
double sinc(double x) {
  // Below this, 1 − x²/6 is exact to the last bit.
  return std::abs(x) < 1e-4 ? 1.0 - x * x / 6.0 : std::sin(x) / x;
}

}  // namespace

Odometry::Odometry(const VehicleConfig& vehicle)
    : radius_m_(vehicle.wheel_radius_m),
      track_m_(vehicle.track_m),
      max_speed_radps_(vehicle.max_wheel_speed_mps / vehicle.wheel_radius_m) {
  state_.pose = {vehicle.start_x_m, vehicle.start_y_m, wrap_angle(vehicle.start_yaw_rad)};
}

void Odometry::update(const std::array<WheelFeedback, 2>& wheels) {
  const bool valid = std::all_of(wheels.begin(), wheels.end(), [](const WheelFeedback& w) {
    return w.valid && is_usable(w.angle_rad) && is_usable(w.speed_radps);
  });
  if (!valid) {
    anchored_ = false;
    state_.twist = {};
    return;
  }
  state_.twist =
      to_twist({wheels[0].speed_radps * radius_m_, wheels[1].speed_radps * radius_m_}, track_m_);
  if (anchored_ && plausible(wheels[0], anchors_[0]) && plausible(wheels[1], anchors_[1])) {
    move((wheels[0].angle_rad - anchors_[0].angle_rad) * radius_m_,
         (wheels[1].angle_rad - anchors_[1].angle_rad) * radius_m_);
  } else if (ever_anchored_) {
    ++reanchored_;
  }
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    anchors_[i] = {wheels[i].angle_rad, wheels[i].stamp};
  }
  anchored_ = ever_anchored_ = true;
}

bool Odometry::plausible(const WheelFeedback& wheel, const Anchor& anchor) const {
  // The limit is twice the vehicle's wheel speed, and 50 ms more, because the stamps are of two
  // messages that may wait in different queues. That is more than any wheel turns, and less than
  // the jump of a count that started anew.
  constexpr double kMargin = 2.0, kStampError_s = 0.05;
  const double elapsed_s = std::max(0.0, to_seconds(wheel.stamp - anchor.stamp));
  return std::abs(wheel.angle_rad - anchor.angle_rad) <=
         kMargin * max_speed_radps_ * (elapsed_s + kStampError_s);
}

void Odometry::move(double left_m, double right_m) {
  const double arc_m = (left_m + right_m) / 2.0;
  const double turn_rad = (right_m - left_m) / track_m_;
  const double chord_m = arc_m * sinc(turn_rad / 2.0);
  Pose2& pose = state_.pose;
  const double direction_rad = pose.yaw_rad + turn_rad / 2.0;
  pose.x_m += chord_m * std::cos(direction_rad);
  pose.y_m += chord_m * std::sin(direction_rad);
  pose.yaw_rad = wrap_angle(pose.yaw_rad + turn_rad);
  state_.distance_m += std::abs(arc_m);
}

}  // namespace tether
