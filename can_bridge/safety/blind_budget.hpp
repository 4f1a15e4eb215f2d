#pragma once

#include <deque>
#include <optional>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Bounds time and distance that a vehicle may drive on plans without a fresh pose. A plan drives
/// on by itself, so without a bound a dead network or a dead controller is noticed only at its
/// horizon.
///
/// Both counts begin when a controller last knew where the vehicle was (CommandWatch::seen): time
/// by the clock, distance by odometry. What is left of them bounds the speed, so that the vehicle
/// can always stop within the budget:
/// - v ≤ a·(t − r) and ω ≤ α·(t − r), with the time t that is left,
/// - v ≤ a·(√(r² + 2·d/a) − r), with the distance d that is left: r·v + v²/(2a) = d,
/// a and α being the decelerations, r = reaction the time until they act. Twists are scaled as a
/// whole, so that the curve stays the curve. Distance does not bound turning on the spot.
///
/// A stop by the drives (quick stop, fault, watchdog) brakes each wheel by itself, at A. With the
/// rims' speed of turning h = |ω|·track/2 it takes (v + h)/A and the distance
/// - (v² + h²)/(2A) if h ≤ v,
/// - v·h/A if h > v: while the wheels turn against each other, v does not fall.
/// These bound the twist, too.
class BlindBudget {
 public:
  struct Config {
    Duration max_time = std::chrono::seconds{1};  ///< > 0
    double max_distance_m = 1.0;                  ///< > 0
    double deceleration_mps2 = 1.5;
    double yaw_deceleration_radps2 = 3.0;
    Duration reaction{};
    double wheel_deceleration_mps2 = 1.5;  ///< A, of a rim
    double half_track_m = 0.6;
  };
  explicit BlindBudget(const Config& config) : config_(config) {}

  /// Once per cycle, in order: `driven_m` by odometry so far, never falling, and when the vehicle
  /// was last seen; none: it was never seen, and the budget is used up.
  void update(Instant now, double driven_m, std::optional<Instant> seen);

  /// Since it was last seen, at the last update(); Duration::max() if it never was.
  Duration blind() const { return blind_; }
  /// By odometry, over that time.
  double blind_m() const { return blind_m_; }

  /// The largest share of `twist` that can still be stopped in time, 0 to 1.
  double share(const Twist& twist) const;
  /// The largest |v| at the yaw rate in force that the distance allows, m/s. A yaw rate may fall
  /// more slowly than share() asks for.
  double speed_beside(double omega_radps) const;

 private:
  double left_m() const;
  /// Largest v with r·v + v²/(2a) ≤ distance_m.
  double stopping_from(double deceleration_mps2, double distance_m) const;

  struct Sample {
    Instant when;
    double driven_m;
  };

  Config config_;
  std::deque<Sample> driven_;  ///< the last max_time, and one before
  Duration blind_ = Duration::max();
  double blind_m_ = 0.0;
};

}  // namespace tether
