#pragma once

#include <deque>

#include "common/base/time.hpp"
#include "controller/estimation/pose_filter.hpp"

namespace tether {

/// What the wheels' encoders said (AGV/ODOMETRY), kept until a pose says what was in force then:
/// odometry is mostly sent more often than poses, and may overtake them.
class WheelReadings {
 public:
  /// Stamps ascend.
  void add(Instant stamp, const Twist& twist) {
    readings_.push_back({stamp, twist});
    if (readings_.size() > kMost) readings_.pop_front();
  }

  /// Moves the filter by `move(until)` to each reading up to `until`, uses the reading, and moves
  /// on to `until`. Readings from before `from`, where the filter is, are dropped.
  template <class Move>
  void use(Instant from, Instant until, PoseFilter& filter, Move move) {
    for (; !readings_.empty() && readings_.front().stamp <= until; readings_.pop_front()) {
      if (readings_.front().stamp <= from) continue;
      move(readings_.front().stamp);
      filter.update_wheels(readings_.front().twist);
    }
    move(until);
  }

 private:
  static constexpr std::size_t kMost = 10000;  // without poses for long
  struct Reading {
    Instant stamp;
    Twist twist;
  };
  std::deque<Reading> readings_;
};

}  // namespace tether
