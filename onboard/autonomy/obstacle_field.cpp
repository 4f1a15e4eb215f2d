#include "onboard/autonomy/obstacle_field.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "common/vehicle/frames.hpp"
#include "onboard/autonomy/swept_way.hpp"

namespace tether {

void MotionTrack::add(Instant stamp, const Pose2& pose, const Twist& twist) {
  if (!entries_.empty() && stamp <= entries_.back().stamp) return;
  entries_.push_back({stamp, pose, twist});
  while (entries_.front().stamp < stamp - kMemory) entries_.pop_front();
}

std::optional<Pose2> MotionTrack::at(Instant when) const {
  const auto after =
      std::upper_bound(entries_.begin(), entries_.end(), when,
                       [](Instant t, const Entry& entry) { return t < entry.stamp; });
  if (after == entries_.begin()) return std::nullopt;
  const Entry& before = *std::prev(after);
  const double since_s = to_seconds(when - before.stamp);
  if (after == entries_.end()) {
    if (when - before.stamp > kReach) return std::nullopt;
    return moved(before.pose, before.twist, since_s);
  }
  const double share = since_s / to_seconds(after->stamp - before.stamp);
  const Pose2 step = relative_to(before.pose, after->pose);
  return compose(before.pose, {share * step.x_m, share * step.y_m, share * step.yaw_rad});
}

std::optional<Twist> MotionTrack::twist(Instant now) const {
  if (entries_.empty() || now - entries_.back().stamp > kReach) return std::nullopt;
  return entries_.back().twist;
}

std::optional<Pose2> MotionTrack::moved_on(const Pose2& pose, Instant stamp, Instant now) const {
  const std::optional<Pose2> then = at(stamp), present = at(now);
  if (!then || !present) return std::nullopt;
  return compose(pose, relative_to(*then, *present));
}

ObstacleField::ObstacleField(const AutonomySettings& settings, const VehicleConfig& vehicle)
    : stopping_(settings),
      outline_(outline_of(vehicle)),
      side_margin_m_(settings.side_margin_m),
      wide_(outline_.wider_by(settings.side_margin_m)),
      oldest_(from_seconds(settings.reaction_s)) {}

void ObstacleField::see(const Scan& scan, const Pose2& at_end, const Twist& twist) {
  any_scan_ = true;
  scan_end_ = scan.end();
  range_m_ = scan.range_max_m;
  first_rad_ = scan.mount.yaw_rad + scan.angle_min_rad;
  last_rad_ = scan.mount.yaw_rad + scan.angle_rad(scan.range_m.size() - 1);
  seen_.clear();
  std::size_t returns = 0;
  for (std::size_t i = 0; i < scan.range_m.size(); ++i) {
    const double range_m = scan.range_m[i];
    if (range_m < scan.range_min_m || range_m > scan.range_max_m || range_m == 0.0) continue;
    ++returns;
    const double angle = scan.angle_rad(i);
    const Position in_vehicle =
        from_frame(scan.mount, {range_m * std::cos(angle), range_m * std::sin(angle)});
    if (outline_.contains(in_vehicle)) continue;
    const Pose2 then = moved({}, twist, -to_seconds(scan_end_ - scan.time_of(i)));
    seen_.push_back(from_frame(at_end, from_frame(then, in_vehicle)));
  }
  returns_ = static_cast<double>(returns) / static_cast<double>(scan.range_m.size());
}

std::string ObstacleField::why_blind(Instant now, const std::optional<Pose2>& odometry) const {
  if (!any_scan_) return "no scan";
  if (now - scan_end_ > oldest_) {
    return fmt::format("the newest scan is {:.0f} ms old", to_milliseconds(now - scan_end_));
  }
  if (returns_ < kLeastReturns) {
    return fmt::format("only {:.0f} % of the scanner's beams return", 100.0 * returns_);
  }
  return odometry ? "" : "no odometry";
}

void ObstacleField::update(Instant now, const std::optional<Pose2>& odometry) {
  blind_ = why_blind(now, odometry);
  points_.clear();
  if (!blind_.empty()) return;
  const double c = std::cos(odometry->yaw_rad), s = std::sin(odometry->yaw_rad);
  for (const Position& p : seen_) {
    const double dx = p.x_m - odometry->x_m, dy = p.y_m - odometry->y_m;
    points_.push_back({c * dx + s * dy, c * dy - s * dx});
  }
  wide_ = outline_.wider_by(margin_beside_m());
}

double ObstacleField::margin_beside_m() const {
  double beside_m = side_margin_m_ + kCloser_m;
  for (const Position& p : points_) {
    if (p.x_m < outline_.rear_m || p.x_m > outline_.front_m) continue;
    beside_m = std::min(beside_m, std::abs(p.y_m) - outline_.half_width_m);
  }
  return std::max(beside_m - kCloser_m, 0.0);
}

bool ObstacleField::looks(double direction_rad) const {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  const double from_first = std::fmod(std::fmod(direction_rad - first_rad_, kTurn) + kTurn, kTurn);
  return from_first <= last_rad_ - first_rad_ + 1e-9;
}

double ObstacleField::clear_m(const Twist& twist) const {
  if (!blind_.empty() || !looks(twist.v_mps < 0.0 ? std::numbers::pi : 0.0)) return 0.0;
  double clear_m = range_m_;
  for (const Position& point : points_) {
    clear_m = std::min(clear_m, way_until_m(point, wide_, twist));
  }
  return clear_m;
}

bool ObstacleField::is_way_free(const std::vector<Pose2>& poses) const {
  return blind_.empty() && is_free(points_, wide_, poses);
}

}  // namespace tether
