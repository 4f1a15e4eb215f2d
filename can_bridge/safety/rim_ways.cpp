#include "can_bridge/safety/rim_ways.hpp"

#include <utility>

#include "common/vehicle/diff_drive.hpp"

namespace tether {

std::optional<std::array<RimWays, 2>> RimSampler::update(
    Instant now, const Twist& setpoint, const std::array<WheelFeedback, 2>& wheels) {
  if (!wheels[0].valid || !wheels[1].valid) {
    last_.reset();
    return std::nullopt;
  }
  const Sample sample{now, {wheels[0].angle_rad, wheels[1].angle_rad}};
  const std::optional<Sample> last = std::exchange(last_, sample);
  if (!last) return std::nullopt;
  const double dt_s = to_seconds(now - last->stamp);
  const WheelSpeeds told = to_wheel_speeds(setpoint, track_m_);
  std::array<RimWays, 2> ways;
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    const double told_mps = i == 0 ? told.left_mps : told.right_mps;
    ways[i] = {dt_s, told_mps, told_mps * dt_s, wheels[i].speed_radps * wheel_radius_m_ * dt_s,
               (sample.angle_rad[i] - last->angle_rad[i]) * wheel_radius_m_};
  }
  return ways;
}

}  // namespace tether
