#pragma once

#include <cstddef>
#include <vector>

#include "common/path/limits.hpp"
#include "common/vehicle/pose.hpp"
#include "controller/detour/smooth_way.hpp"

namespace tether {

/// Drives along a smooth way: turns on the spot follow the heading, curves are followed by pure
/// pursuit (Coulter: Implementation of the pure pursuit path tracking algorithm. CMU-RI-TR-92-01),
/// kAhead_m ahead, as fast as the profile says for where the vehicle is. Pure.
class WayFollower {
 public:
  static constexpr double kAhead_m = 0.75;
  static constexpr double kTurnGain = 1.0;  ///< 1/s
  static constexpr double kTurned_rad = 0.06;
  static constexpr double kReached_m = 0.1;  ///< distance to a curve's end
  static constexpr double kCreep_mps = 0.1;  ///< where the profile rests, and the vehicle must not
  static constexpr double kApart_m = 0.3;    ///< distance between poses of the way
  static constexpr double kTurnApart_rad = 0.25;

  WayFollower() = default;  ///< no way
  WayFollower(std::vector<WayLeg> legs, const PathLimits& limits);

  bool empty() const { return legs_.empty(); }

  /// The twist for a vehicle at `pose`, which goes on from where the last one was; zero at the end.
  Twist drive(const Pose2& pose);
  /// Whether it came to another leg, kApart_m or kTurnApart_rad farther since this was true last.
  bool made_headway();

  double off_m(const Pose2& pose) const;  ///< from the nearest place of the way
  std::vector<Pose2> ahead() const;       ///< rest of the way, kApart_m apart
  const std::vector<WayLeg>& legs() const { return legs_; }

 private:
  struct Place {
    double s_m, v_mps;
    Pose2 pose;
  };
  void pass_by(const Pose2& pose);
  bool has_turned(const Pose2& pose);
  bool has_arrived(const Pose2& pose);
  Twist turn() const;
  Twist pursue(const Pose2& pose) const;
  Position aim() const;
  double profile_mps() const;

  std::vector<WayLeg> legs_;
  std::vector<std::vector<Place>> places_;  ///< places of each leg; none for a turn; none of a turn
  double fastest_turn_radps_ = 0.0, creep_mps_ = 0.0;
  std::size_t leg_ = 0;
  std::size_t place_ = 0;    ///< place on the leg that is nearest to the vehicle
  double turned_rad_ = 0.0;  ///< progress of the leg
  std::size_t leg_then_ = 0;
  double way_then_ = 0.0;
};

}  // namespace tether
