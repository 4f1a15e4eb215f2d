#include "localiser/matching/beams.hpp"

#include <algorithm>
#include <cmath>

#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

/// Number of beams between two computed places of the scanner; in between it moves straight.
constexpr std::size_t kSpan = 32;

/// Pose of the scanner at a beam's time, in the vehicle's frame when it was at `then` by odometry.
Pose2 scanner_at(const Scan& scan, const OdometryTrack& odometry, const Pose2& then,
                 std::size_t beam) {
  if (odometry.empty()) return scan.mount;
  return compose(relative_to(then, odometry.at(scan.time_of(beam))->pose), scan.mount);
}

}  // namespace

std::vector<Beam> beams_of(const Scan& scan, const OdometryTrack& odometry, Instant when,
                           std::size_t most) {
  const std::size_t count = scan.range_m.size();
  const std::size_t chosen = std::min(most, count);
  const Pose2 then = odometry.empty() ? Pose2{} : odometry.at(when)->pose;
  std::vector<Beam> beams;
  beams.reserve(chosen);
  Pose2 from, to;
  std::size_t span = count;  // none yet
  for (std::size_t k = 0; k < chosen; ++k) {
    const std::size_t i = k * count / chosen;
    const double range_m = scan.range_m[i];
    if (range_m <= 0.0 || range_m < scan.range_min_m || range_m > scan.range_max_m) continue;
    if (i / kSpan != span) {
      span = i / kSpan;
      from = scanner_at(scan, odometry, then, span * kSpan);
      to = scanner_at(scan, odometry, then, (span + 1) * kSpan);
    }
    const double share = static_cast<double>(i % kSpan) / kSpan;
    const double angle_rad =
        scan.angle_rad(i) + from.yaw_rad + share * wrap_angle(to.yaw_rad - from.yaw_rad);
    const double c = std::cos(angle_rad), s = std::sin(angle_rad);
    beams.push_back({static_cast<float>(from.x_m + share * (to.x_m - from.x_m) + range_m * c),
                     static_cast<float>(from.y_m + share * (to.y_m - from.y_m) + range_m * s),
                     static_cast<float>(c), static_cast<float>(s),
                     static_cast<float>(i) / static_cast<float>(count)});
  }
  return beams;
}

}  // namespace tether
