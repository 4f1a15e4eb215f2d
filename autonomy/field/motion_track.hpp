#pragma once

#include <deque>
#include <optional>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Where the vehicle was and is by its wheels: the odometry of the last kMemory, for moving scans
/// and poses from when they were measured to now. Pure; stamps ascend.
class MotionTrack {
 public:
  static constexpr Duration kMemory = std::chrono::seconds{2};
  /// Odometry that is older says nothing of the present.
  static constexpr Duration kReach = std::chrono::milliseconds{200};

  void add(Instant stamp, const Pose2& pose, const Twist& twist);

  /// In the odometry's own frame: between two messages on an arc, at most kReach beyond the newest;
  /// none for times that it does not know of.
  std::optional<Pose2> at(Instant when) const;
  /// Latest motion of the wheels, if it is no older than kReach.
  std::optional<Twist> twist(Instant now) const;
  /// A pose measured at `stamp`, moved on to `now`.
  std::optional<Pose2> moved_on(const Pose2& pose, Instant stamp, Instant now) const;

 private:
  struct Entry {
    Instant stamp;
    Pose2 pose;
    Twist twist;
  };
  std::deque<Entry> entries_;
};

}  // namespace tether
