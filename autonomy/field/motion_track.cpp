#include "autonomy/field/motion_track.hpp"

#include <algorithm>
#include <iterator>

#include "autonomy/field/swept_way.hpp"
#include "common/vehicle/frames.hpp"

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

}  // namespace tether
