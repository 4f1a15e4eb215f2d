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

/// The covariance of a pose that moved by (dx, dy) in the world's frame: F P Fᵀ, where F is the
/// identity but for the derivatives of x and y by the yaw, −dy and dx.
PoseCovariance moved(const PoseCovariance& p, double dx_m, double dy_m) {
  const double a = -dy_m, b = dx_m;
  return {p.x_x + 2.0 * a * p.x_yaw + a * a * p.yaw_yaw,
          p.x_y + a * p.y_yaw + b * p.x_yaw + a * b * p.yaw_yaw,
          p.x_yaw + a * p.yaw_yaw,
          p.y_y + 2.0 * b * p.y_yaw + b * b * p.yaw_yaw,
          p.y_yaw + b * p.yaw_yaw,
          p.yaw_yaw};
}

/// Adds an error along (x, y, yaw) with this variance.
void add(PoseCovariance& p, double x, double y, double yaw, double variance) {
  p.x_x += x * x * variance;
  p.x_y += x * y * variance;
  p.x_yaw += x * yaw * variance;
  p.y_y += y * y * variance;
  p.y_yaw += y * yaw * variance;
  p.yaw_yaw += yaw * yaw * variance;
}

}  // namespace

Odometry::Odometry(const VehicleConfig& vehicle)
    : radius_m_(vehicle.wheel_radius_m),
      track_m_(vehicle.track_m),
      max_speed_mps_(vehicle.max_wheel_speed_mps) {
  state_.pose = {vehicle.start_x_m, vehicle.start_y_m, wrap_angle(vehicle.start_yaw_rad)};
}

void Odometry::update(const std::array<WheelFeedback, 2>& wheels) {
  const bool valid = std::all_of(wheels.begin(), wheels.end(), [](const WheelFeedback& w) {
    return w.valid && is_usable(w.angle_rad) && is_usable(w.speed_radps);
  });
  if (!valid) {
    interrupted_ = true;
    state_.twist = {};
    return;
  }
  state_.twist =
      to_twist({wheels[0].speed_radps * radius_m_, wheels[1].speed_radps * radius_m_}, track_m_);
  PerWheel rims_m{}, uncounted_m{};
  bool jumped = false, gap = interrupted_;
  for (std::size_t i = 0; i < wheels.size() && anchored_; ++i) {
    rims_m[i] = (wheels[i].angle_rad - anchors_[i].angle_rad) * radius_m_;
    uncounted_m[i] = (wheels[i].uncounted_rad - anchors_[i].uncounted_rad) * radius_m_;
    gap = gap || wheels[i].stamp - anchors_[i].stamp > kGap;
    jumped = jumped || std::abs(rims_m[i]) > most_m(wheels[i], anchors_[i]);
  }
  if (jumped) {
    for (std::size_t i = 0; i < wheels.size(); ++i) {
      uncounted_m[i] += std::min(std::abs(rims_m[i]), most_m(wheels[i], anchors_[i]));
    }
    rims_m = {};
  }
  PerWheel variances_m2{};
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    variances_m2[i] = kVariancePerMetre * (gap ? kGapFactor : 1.0) * std::abs(rims_m[i]) +
                      uncounted_m[i] * uncounted_m[i] / 3.0;
    anchors_[i] = {wheels[i].angle_rad, wheels[i].uncounted_rad, wheels[i].stamp};
  }
  if (std::max(uncounted_m[0], uncounted_m[1]) > 0.0) {
    ++reanchored_;
  } else if (gap && anchored_) {
    ++gaps_;
  }
  move(rims_m, variances_m2, gap);
  anchored_ = true;
  interrupted_ = false;
}

double Odometry::most_m(const WheelFeedback& wheel, const Anchor& anchor) const {
  // The limit is twice the vehicle's wheel speed, and 50 ms more, because the stamps are of two
  // messages that may wait in different queues. That is more than any wheel turns, and less than
  // the jump of a count that started anew.
  constexpr double kMargin = 2.0, kStampError_s = 0.05;
  const double elapsed_s = std::max(0.0, to_seconds(wheel.stamp - anchor.stamp));
  return kMargin * max_speed_mps_ * (elapsed_s + kStampError_s);
}

void Odometry::move(const PerWheel& rims_m, const PerWheel& variances_m2, bool gap) {
  const auto [left_m, right_m] = rims_m;
  const double arc_m = (left_m + right_m) / 2.0;
  const double turn_rad = (right_m - left_m) / track_m_;
  const double chord_m = arc_m * sinc(turn_rad / 2.0);
  Pose2& pose = state_.pose;
  const double direction_rad = pose.yaw_rad + turn_rad / 2.0;
  const double dx_m = chord_m * std::cos(direction_rad);
  const double dy_m = chord_m * std::sin(direction_rad);

  PoseCovariance& p = state_.covariance;
  p = moved(p, dx_m, dy_m);
  for (std::size_t i = 0; i < variances_m2.size(); ++i) {
    // Derivatives by this wheel's way: half of it moves the midpoint, and it turns the chord.
    const double yaw_per_m = (i == 0 ? -1.0 : 1.0) / track_m_;
    add(p, std::cos(direction_rad) / 2.0 - dy_m * yaw_per_m / 2.0,
        std::sin(direction_rad) / 2.0 + dx_m * yaw_per_m / 2.0, yaw_per_m, variances_m2[i]);
  }
  if (gap) {
    add(p, -std::sin(direction_rad), std::cos(direction_rad), 0.0,
        arc_m * arc_m * turn_rad * turn_rad / 12.0);
  }

  pose.x_m += dx_m;
  pose.y_m += dy_m;
  pose.yaw_rad = wrap_angle(pose.yaw_rad + turn_rad);
  state_.distance_m += std::abs(arc_m);
}

}  // namespace tether
