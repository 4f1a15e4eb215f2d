#include "can_bridge/safety/witness_monitor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tether {

void WitnessMonitor::Ways::add(const RimWays& rim) {
  told += rim.told_m;
  reported += rim.reported_m;
  counted += rim.counted_m;
}

std::string WitnessMonitor::update(Instant now, const Twist& setpoint,
                                   const std::array<WheelFeedback, 2>& wheels) {
  if (sampler_.begins()) wheels_ = {};
  const auto ways = sampler_.update(now, setpoint, wheels);
  if (!ways) return "";
  std::string trouble;
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    const Ways* const found = contradiction(i, (*ways)[i]);
    if (found != nullptr && trouble.empty()) trouble = text(i, *found);
  }
  return trouble;
}

std::string WitnessMonitor::suspicion() const {
  for (std::size_t i = 0; i < wheels_.size(); ++i) {
    const Wheel& w = wheels_[i];
    if (std::max(w.more, w.less) >= kLimit_m / 2.0) return text(i, w.differing);
  }
  return "";
}

std::string WitnessMonitor::text(std::size_t i, const Ways& ways) {
  return fmt::format(
      "the {} wheel: {} (on {:.2f} m by setpoint: {:.2f} m by speed, {:.2f} m by position)",
      side_name(i), diagnosis(ways), ways.told, ways.reported, ways.counted);
}

const WitnessMonitor::Ways* WitnessMonitor::contradiction(std::size_t i, const RimWays& rim) {
  Wheel& w = wheels_[i];
  const double longer_m = std::max(std::abs(rim.reported_m), std::abs(rim.counted_m));
  const double allowed_m = kAllowed_mps * rim.dt_s + kAllowedShare * longer_m;
  if (std::max(w.more, w.less) == 0.0) w.differing = {};
  w.differing.add(rim);
  w.more = std::max(0.0, w.more + rim.reported_m - rim.counted_m - allowed_m);
  w.less = std::max(0.0, w.less - rim.reported_m + rim.counted_m - allowed_m);
  if (!proven_[i]) {
    w.first.add(rim);
    w.proof += std::max(longer_m, std::abs(rim.told_m));
    if (w.proof >= kProof_m) {
      // While it slows down or turns back, a wheel that lags is ahead.
      const bool moves_away = rim.told_mps * w.first.told > 0.0;
      if (!agree(w.first) || (moves_away && !follow(w.first, rim.told_mps))) return &w.first;
      proven_[i] = moves_away;
    }
  }
  return std::max(w.more, w.less) >= kLimit_m ? &w.differing : nullptr;
}

bool WitnessMonitor::agree(const Ways& w) {
  const double way_m = std::max({std::abs(w.reported), std::abs(w.counted), kProof_m / 2.0});
  return std::abs(w.reported - w.counted) <= kProofShare * way_m;
}

bool WitnessMonitor::follow(const Ways& w, double told_mps) {
  const double told_m = std::abs(w.told), way_m = std::copysign(w.counted, w.counted * w.told);
  const double allowed_m = kProofShare * std::max(told_m, kProof_m / 2.0);
  return way_m <= told_m + allowed_m && way_m >= told_m - allowed_m - kLag_s * std::abs(told_mps);
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
  if (is(position, 0.0) && is(speed, 0.0)) {
    return "speed (0x606C) and position (0x6064) agree that it hardly turns: blocked, or one "
           "encoder, which serves both, is frozen";
  }
  const double longer_m = std::max(std::abs(ways.reported), std::abs(ways.counted));
  if (std::abs(ways.reported - ways.counted) <= kAllowedShare * longer_m) {
    return fmt::format(
        "speed (0x606C) and position (0x6064) agree on {:.2f} times its setpoint: "
        "target_velocity_per_rps, or the scales of both, are wrong",
        position);
  }
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
