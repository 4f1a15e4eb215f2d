#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <optional>

#include "common/base/time.hpp"
#include "common/vehicle/dead_reckoning.hpp"
#include "controller/laws/pose_filter.hpp"

namespace tether {

/// Readings of the wheels' encoders (AGV/ODOMETRY), kept until a pose of that time arrives:
/// odometry is mostly sent more often than poses, and may overtake them.
///
/// Messages have the dead reckoning since the start. So what was rolled between any two of them is
/// known exactly, however many were lost in between; between their stamps it is interpolated, by
/// cubics that have the right speeds at both ends (Hermite's). A vehicle that stands for three
/// quarters of the time T between them and then accelerates by a is a T²/64 from the cubic in the
/// middle: that is taken for the standard deviation of a pose in between.
class WheelReadings {
 public:
  /// Reckoning begins at `start`, where the vehicle stands before t = 0.
  explicit WheelReadings(const Pose2& start) {
    readings_.push_back({kStart, {}, {}});
    readings_.back().reckoning.pose = start;
  }

  /// Stamps ascend. If the vehicle restarted its odometry, earlier readings are discarded.
  void add(Instant stamp, const DeadReckoning& reckoning, const Twist& twist);
  /// Discards the readings before the last one up to `until`.
  void forget(Instant until);
  /// The stamp of the newest reading, if it is after `from` and another one was up to `from`.
  std::optional<Instant> newest_after(Instant from) const;
  /// The newest reading up to `until`.
  std::optional<Twist> twist_before(Instant until) const;

  /// Moves `filter` from `from` to `until` by what the wheels rolled, as far as readings are on
  /// both sides; else by `move(from, until, vehicle)`, which advances a vehicle along what was in
  /// force then. Whether any of it was rolled.
  template <class Move>
  bool use(Instant from, Instant until, PoseFilter& filter, Move move) const {
    bool any = false;
    for_each_part(
        from, until, [&](Instant begin, Instant end) { move(begin, end, filter); },
        [&](std::size_t i, Instant begin, Instant end) {
          roll(i, begin, end, filter, move);
          widen_between(i, begin, end, filter);
          any = true;
        });
    return any;
  }
  /// The same with a filter that knows itself what may have been in force.
  template <class Filter>
  void use(Instant from, Instant until, Filter& filter) const {
    for_each_part(
        from, until, [&](Instant, Instant end) { filter.advance(end); },
        [&](std::size_t i, Instant begin, Instant end) {
          filter.roll(between(i, begin, end), end);
          widen_between(i, begin, end, filter);
        });
  }

 private:
  static constexpr std::size_t kMost = 10000;  // without poses for long
  struct Reading {
    Instant stamp;
    DeadReckoning reckoning;
    Twist twist;
  };
  /// Rims that do what is commanded, with the lag that the filter believes in and one that is a
  /// little longer.
  struct LaggingRims {
    static constexpr double kMore_s = 1e-3;

    MotionModel model, slower;
    MotionModel::State state, slower_state;

    explicit LaggingRims(const PoseFilter& filter);
    void advance(const Twist& twist, double dt_s);
    bool stands() const;
    LagReading compare(const WheelSpeeds& read) const;
  };

  /// Divides a time at the readings: unseen(begin, end), or rolled(i, begin, end) between reading
  /// `i` and the next.
  template <class Unseen, class RolledPart>
  void for_each_part(Instant from, Instant until, Unseen unseen, RolledPart rolled) const {
    if (!heard_) {
      unseen(from, until);
      return;
    }
    for (std::size_t i = index_at(from); from < until;) {
      const bool last = i + 1 == readings_.size();
      if (readings_[i].stamp > from || last) {
        const std::size_t next = readings_[i].stamp > from ? i : i + 1;
        const Instant end =
            next < readings_.size() ? std::min(until, readings_[next].stamp) : until;
        unseen(from, end);
        from = end;
        i = std::min(next, readings_.size() - 1);
        continue;
      }
      const Instant end = std::min(until, readings_[i + 1].stamp);
      rolled(i, from, end);
      from = end;
      ++i;
    }
  }
  template <class Filter>
  void widen_between(std::size_t i, Instant begin, Instant end, Filter& filter) const {
    if (begin > readings_[i].stamp) filter.widen(between_m(i));
    if (end < readings_[i + 1].stamp) filter.widen(between_m(i));
  }
  template <class Move>
  void roll(std::size_t i, Instant from, Instant end, PoseFilter& filter, Move& move) const {
    const double dt_s = to_seconds(end - from);
    if (filter.adaptation().lag) {
      LaggingRims rims(filter);
      move(from, end, rims);
      filter.roll(between(i, from, end), dt_s);
      filter.update_lag(rims.compare(filter.state().rim));
      return;
    }
    filter.roll(between(i, from, end), dt_s);
  }
  /// The last reading up to `when`; 0 if there is none.
  std::size_t index_at(Instant when) const;
  /// Travel in a part of the time between reading `i` and the next.
  Rolled between(std::size_t i, Instant from, Instant end) const;
  Reading at(std::size_t i, Instant when) const;
  /// How far the vehicle may be from the cubic: standard deviation.
  double between_m(std::size_t i) const;

  std::deque<Reading> readings_;  ///< never empty
  bool heard_ = false;
};

}  // namespace tether
