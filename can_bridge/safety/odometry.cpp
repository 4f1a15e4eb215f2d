#include "can_bridge/safety/odometry.hpp"

#include <algorithm>
#include <cmath>

#include "common/vehicle/diff_drive.hpp"

namespace tether {

Odometry::Odometry(const VehicleConfig& vehicle)
    : radius_m_(vehicle.wheel_radius_m),
      track_m_(vehicle.track_m),
      max_speed_mps_(vehicle.max_wheel_speed_mps) {
  state_.pose = vehicle.start_pose();
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
  } else if (gap && anchored_ && (rims_m[0] != 0.0 || rims_m[1] != 0.0)) {
    ++gaps_;
  }
  move(rims_m, variances_m2, gap);
  anchored_ = true;
  interrupted_ = false;
}

double Odometry::most_m(const WheelFeedback& wheel, const Anchor& anchor) const {
  // The limit is twice the vehicle's wheel speed, and 50 ms more, because the stamps are of two
  // messages that may wait in different queues. That is more than any wheel turns, and less than
  // the jump of a count that restarted.
  constexpr double kMargin = 2.0, kStampError_s = 0.05;
  const double elapsed_s = std::max(0.0, to_seconds(wheel.stamp - anchor.stamp));
  return kMargin * max_speed_mps_ * (elapsed_s + kStampError_s);
}

void Odometry::move(const PerWheel& rims_m, const PerWheel& variances_m2, bool gap) {
  const auto [arc_m, turn_rad, direction_rad] =
      state_.move({rims_m[0], rims_m[1], variances_m2[0], variances_m2[1]}, track_m_);
  if (!gap) return;
  state_.covariance.add(-std::sin(direction_rad), std::cos(direction_rad), 0.0,
                        arc_m * arc_m * turn_rad * turn_rad / 12.0);
}

}  // namespace tether
