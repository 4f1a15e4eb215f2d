#pragma once

#include <array>
#include <cstdint>

#include "can_bridge/drivetrain/drive_profile.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Dead reckoning from both wheels' angles. Between two updates the wheels are taken to turn at a
/// constant ratio, so that the axle's midpoint runs along an arc: of length d = (d_l + d_r)/2 and
/// angle a = (d_r − d_l)/track, with the chord d·sin(a/2)/(a/2) in direction yaw + a/2. Exact for
/// arcs, whatever their length. Drifts with wheel slip, as all odometry.
///
/// While a wheel's feedback is invalid nothing is counted, and what the wheels turned meanwhile is
/// lost: counting starts anew (`reanchored`) with the next valid pair. The same where an angle
/// jumps faster than the wheel can turn: its drive started anew, or its count was preset.
class Odometry {
 public:
  struct State {
    Pose2 pose;               ///< axle midpoint; starts at the vehicle's start pose
    Twist twist;              ///< of the newest valid wheel speeds; zero before and while invalid
    double distance_m = 0.0;  ///< path length, never falling
  };

  explicit Odometry(const VehicleConfig& vehicle);

  /// The wheels' newest feedback, left and right; once per control cycle.
  void update(const std::array<WheelFeedback, 2>& wheels);

  const State& state() const { return state_; }
  /// How often the count was taken up anew after an interruption or a jump.
  std::int64_t reanchored() const { return reanchored_; }

 private:
  struct Anchor {
    double angle_rad = 0.0;
    Instant stamp{};
  };
  bool plausible(const WheelFeedback& wheel, const Anchor& anchor) const;
  void move(double left_m, double right_m);

  double radius_m_;
  double track_m_;
  double max_speed_radps_;
  State state_;
  std::array<Anchor, 2> anchors_;
  bool anchored_ = false;
  bool ever_anchored_ = false;
  std::int64_t reanchored_ = 0;
};

}  // namespace tether
