#include "onboard/localiser/odometry_track.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

Pose2 along_arc(const Pose2& from, const Twist& twist, double seconds) {
  const double turn_rad = twist.omega_radps * seconds, way_m = twist.v_mps * seconds;
  // Direction of the chord, nearly as long.
  const double direction_rad = from.yaw_rad + 0.5 * turn_rad;
  return {from.x_m + way_m * std::cos(direction_rad), from.y_m + way_m * std::sin(direction_rad),
          wrap_angle(from.yaw_rad + turn_rad)};
}

}  // namespace

bool OdometryTrack::add(const OdometryReading& reading) {
  bool goes_on = true;
  if (!readings_.empty()) {
    const OdometryReading& last = readings_.back();
    const double seconds = to_seconds(reading.stamp - last.stamp);
    const double way_m =
        std::hypot(reading.pose.x_m - last.pose.x_m, reading.pose.y_m - last.pose.y_m);
    goes_on = way_m <= kMost_mps * seconds + 0.1 && reading.distance_m >= last.distance_m;
    if (!goes_on) readings_.clear();
  }
  readings_.push_back(reading);
  while (readings_.size() > 2 && readings_[1].stamp < reading.stamp - kMemory) {
    readings_.pop_front();
  }
  return goes_on;
}

std::optional<OdometryTrack::Point> OdometryTrack::at(Instant when) const {
  if (readings_.empty()) return std::nullopt;
  const OdometryReading& first = readings_.front();
  if (when <= first.stamp)
    return Point{first.pose, first.distance_m, to_seconds(first.stamp - when)};
  const OdometryReading& last = readings_.back();
  if (when >= last.stamp) {
    const double beyond_s = to_seconds(when - last.stamp);
    return Point{along_arc(last.pose, last.twist, beyond_s),
                 last.distance_m + std::abs(last.twist.v_mps) * beyond_s, beyond_s};
  }
  const auto after = std::upper_bound(
      readings_.begin(), readings_.end(), when,
      [](Instant at, const OdometryReading& reading) { return at < reading.stamp; });
  const OdometryReading &a = *(after - 1), &b = *after;
  const double share = to_seconds(when - a.stamp) / to_seconds(b.stamp - a.stamp);
  return Point{{a.pose.x_m + share * (b.pose.x_m - a.pose.x_m),
                a.pose.y_m + share * (b.pose.y_m - a.pose.y_m),
                wrap_angle(a.pose.yaw_rad + share * wrap_angle(b.pose.yaw_rad - a.pose.yaw_rad))},
               a.distance_m + share * (b.distance_m - a.distance_m),
               0.0};
}

}  // namespace tether
