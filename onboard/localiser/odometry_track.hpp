#pragma once

#include <deque>
#include <optional>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// An odometry_t, as far as the localiser uses it.
struct OdometryReading {
  Instant stamp;
  Pose2 pose;               ///< by the wheels alone
  double distance_m = 0.0;  ///< way so far, never falling
  Twist twist;
};

/// Where the wheels say that the vehicle was, at any time of the last kMemory. Readings add up, so
/// what lost ones said is in the next. Pure.
class OdometryTrack {
 public:
  static constexpr Duration kMemory = std::chrono::seconds{10};
  /// No vehicle moves like this: wheels that seem to were set to another pose.
  static constexpr double kMost_mps = 20.0;

  struct Point {
    Pose2 pose;
    double distance_m = 0.0;
    double beyond_s = 0.0;  ///< how long after the last reading, or before the first
  };

  /// A reading stamped later than those before. False if the wheels were set to another pose: then
  /// all before is forgotten.
  bool add(const OdometryReading& reading);
  bool empty() const { return readings_.empty(); }
  /// Between readings along a straight line; behind the last one along the arc of its twist; before
  /// the first one it stood. nullopt if there was no reading.
  std::optional<Point> at(Instant when) const;

 private:
  std::deque<OdometryReading> readings_;
};

}  // namespace tether
