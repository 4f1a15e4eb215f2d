#pragma once

#include <array>
#include <string>

#include "can_bridge/safety/rim_ways.hpp"

namespace tether {

/// Notices a wheel that does not turn as its setpoint says: encoder frozen or unplugged, wheel
/// blocked, drive that hangs, wrong sign. ISO 3691-4 (4.2) wants a vehicle braked that has lost
/// control of speed or steering; without this, one frozen encoder makes it drive by false odometry.
///
/// For each wheel the difference between setpoint and turned way is added up, cycle by cycle, less
/// an allowance of a fixed speed + a share of the setpoint, for each sign separately and never
/// below zero (a one-sided CUSUM test; E. S. Page, Biometrika 41, 1954). When a sum reaches a
/// limit, the wheel does not follow. Three such tests run: a fast one, one for slow speeds, and one
/// for small errors that last.
///
/// A wheel frozen at 2.8 m/s is noticed in 0.1 s, at 0.3 m/s in 1.3 s, at 0.1 m/s in 5 s, below
/// 0.03 m/s not at all; one that creeps while it should stand, at 0.1 m/s in 3.2 s, at 0.05 m/s in
/// 8.4 s, at 0.02 m/s not at all. A wheel at 70 % of its setpoint is noticed within 4.5 m from
/// 1 m/s on; the smallest error that is seen is 10 % + 0.02 m/s, after a way that grows without
/// limit towards it. Drives that lag 0.2 s behind ramps of 1.5 m/s² pass.
class FollowMonitor {
 public:
  struct Test {
    double allowed_mps;
    double allowed_share;
    double limit_m;
  };
  static constexpr std::array<Test, 3> kTests{
      {{0.1, 0.3, 0.15}, {0.02, 0.3, 0.25}, {0.02, 0.1, 0.8}}};

  FollowMonitor(double track_m, double wheel_radius_m)
      : wheel_radius_m_(wheel_radius_m), sampler_(track_m, wheel_radius_m) {}

  /// Begins again: when following begins.
  void reset() { sampler_.reset(); }

  /// Call it once per cycle, with the twist in force since the last cycle and the newest feedback.
  /// Returns what is wrong, for a technician; "" if both wheels follow. Invalid feedback begins
  /// again.
  std::string update(Instant now, const Twist& setpoint,
                     const std::array<WheelFeedback, 2>& wheels);

 private:
  struct Sums {
    double behind_m = 0.0;
    double ahead_m = 0.0;
  };
  static bool exceeds(const Test& test, Sums& sums, double wanted_m, double behind_m, double dt);

  double wheel_radius_m_;
  RimSampler sampler_;
  std::array<std::array<Sums, kTests.size()>, 2> sums_;  ///< sums of each wheel, by each test
};

}  // namespace tether
