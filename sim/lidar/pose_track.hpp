#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Where the vehicle was in the last while: poses between which it moved straight and turned
/// evenly.
class PoseTrack {
 public:
  /// Times must ascend.
  void add(Instant when, const Pose2& pose) { points_.push_back({when, pose}); }
  bool empty() const { return points_.empty(); }

  /// Between two poses, or as the last two go on; before the first, that. `near` is where to look
  /// first, and then where it was found: 0 at first, for times that ascend. There must be a pose.
  Pose2 at(Instant when, std::size_t& near) const {
    if (points_.size() < 2 || when <= points_.front().when) return points_.front().pose;
    while (near + 2 < points_.size() && points_[near + 1].when < when) ++near;
    const Point &a = points_[near], &b = points_[near + 1];
    const double share = to_seconds(when - a.when) / to_seconds(b.when - a.when);
    return {a.pose.x_m + share * (b.pose.x_m - a.pose.x_m),
            a.pose.y_m + share * (b.pose.y_m - a.pose.y_m),
            a.pose.yaw_rad + share * wrap_angle(b.pose.yaw_rad - a.pose.yaw_rad)};
  }

  /// Forgets what no time from `when` on needs.
  void forget_before(Instant when) {
    const auto after = std::find_if(points_.begin(), points_.end(),
                                    [when](const Point& p) { return p.when > when; });
    const auto known = after - points_.begin(), most = std::ssize(points_) - 2;
    const auto forgotten = std::min(known - 1, most);
    if (forgotten > 0) points_.erase(points_.begin(), points_.begin() + forgotten);
  }

 private:
  struct Point {
    Instant when;
    Pose2 pose;
  };
  std::vector<Point> points_;
};

}  // namespace tether
