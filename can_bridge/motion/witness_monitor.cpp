#include "can_bridge/motion/witness_monitor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/vehicle/diff_drive.hpp"

namespace tether {

std::string WitnessMonitor::update(Instant now, const Twist& setpoint,
                                   const std::array<WheelFeedback, 2>& wheels) {
  if (!wheels[0].valid || !wheels[1].valid) {
    last_.reset();
    return "";
  }
  const Sample sample{now, {wheels[0].angle_rad, wheels[1].angle_rad}};
  if (!last_) {
    last_ = sample;
    ways_ = {};
    return "";
  }
  const double dt_s = to_seconds(now - last_->stamp);
  const WheelSpeeds told = to_wheel_speeds(setpoint, track_m_);
  std::string trouble;
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    const double told_m = (i == 0 ? told.left_mps : told.right_mps) * dt_s;
    const double reported_m = wheels[i].speed_radps * wheel_radius_m_ * dt_s;
    const double counted_m = (sample.angle_rad[i] - last_->angle_rad[i]) * wheel_radius_m_;
    if (!contradicts(i, told_m, reported_m, counted_m, dt_s) || !trouble.empty()) continue;
    trouble = fmt::format(
        "the {} wheel: {} (on {:.2f} m by setpoint: {:.2f} m by speed, {:.2f} m by position)",
        i == 0 ? "left" : "right", diagnosis(ways_[i]), ways_[i].told, ways_[i].reported,
        ways_[i].counted);
  }
  last_ = sample;
  return trouble;
}

bool WitnessMonitor::contradicts(std::size_t i, double told_m, double reported_m, double counted_m,
                                 double dt_s) {
  Ways& w = ways_[i];
  w.told += told_m;
  w.reported += reported_m;
  w.counted += counted_m;
  const double longer_m = std::max(std::abs(reported_m), std::abs(counted_m));
  const double allowed_m = kAllowed_mps * dt_s + kAllowedShare * longer_m;
  w.more = std::max(0.0, w.more + reported_m - counted_m - allowed_m);
  w.less = std::max(0.0, w.less - reported_m + counted_m - allowed_m);
  if (!proven_[i]) {
    w.proof += std::max(longer_m, std::abs(told_m));
    if (w.proof >= kProof_m) {
      const double way_m = std::max(std::abs(w.reported), std::abs(w.counted));
      if (std::abs(w.reported - w.counted) > kProofShare * std::max(way_m, kProof_m / 2.0)) {
        return true;
      }
      proven_[i] = true;
    }
  }
  return std::max(w.more, w.less) >= kLimit_m;
}

std::string WitnessMonitor::diagnosis(const Ways& ways) {
  constexpr double kTold_m = 0.05;
  // A setpoint that is no way tells nothing about which witness is right.
  if (std::abs(ways.told) < kTold_m) {
    return "speed (0x606C) and position (0x6064) contradict each other, without a setpoint that "
           "moves: is the vehicle pushed, is one of them frozen?";
  }
  const double speed = ways.reported / ways.told, position = ways.counted / ways.told;
  constexpr double kNear = 0.35;  // drives lag behind their setpoints
  const auto is = [](double value, double wanted) { return std::abs(value - wanted) < kNear; };
  if (is(position, 1.0) && is(speed, 0.0)) {
    return "its reported speed (0x606C) stays at zero while its position counts: the object is not "
           "the wheel's speed";
  }
  if (is(position, 1.0) && is(speed, -1.0)) return "the sign of its reported speed is reversed";
  if (is(speed, 1.0) && is(position, 0.0)) {
    return "its position (0x6064) stands still while its speed is as told: encoder frozen";
  }
  if (is(speed, 1.0) && is(position, -1.0)) return "the sign of its position is reversed";
  const double ratio = ways.reported / ways.counted;
  if (std::abs(position - 1.0) <= std::abs(speed - 1.0)) {
    return fmt::format(
        "its reported speed is {:.2f} times what its position says: "
        "actual_velocity_per_rps is wrong",
        ratio);
  }
  return fmt::format(
      "its position counts {:.2f} times what its speed says: counts_per_revolution is "
      "wrong, or the encoder slips",
      1.0 / ratio);
}

}  // namespace tether
