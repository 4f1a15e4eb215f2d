#pragma once

#include <array>
#include <cstdint>

#include "can_bridge/drivetrain/drive_profile.hpp"
#include "common/vehicle/dead_reckoning.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Dead reckoning from both wheels' angles. Between two updates the wheels are taken to turn at a
/// constant ratio (DeadReckoning): exact for arcs, of length d and angle a, however long. Drifts
/// with wheel slip, as all odometry.
///
/// A gap is time without valid feedback of both wheels, or more than kGap between two reports. What
/// the drives counted meanwhile is taken up with the next valid pair, as one arc (`gaps`). Where
/// they did not count (WheelFeedback::uncounted_rad), or an angle jumps faster than the wheel can
/// turn, the pose stays where it is and becomes less certain (`reanchored`).
///
/// Covariance. It is zero at the start pose, and grows by the model of L. Kleeman (Odometry error
/// covariance estimation for two wheel robot vehicles, Monash University, MECSE-95-1, 1995; K. S.
/// Chong, L. Kleeman, Accurate odometry and error modelling for a mobile robot, ICRA 1997): each
/// wheel's way has an error of its own, white, with variance k²·|way|. What is systematic (radius,
/// track) is taken to be calibrated (docs/howto/drivetrain.md, "The first slow metre").
/// - kVariancePerMetre: 3 mm standard deviation after a wheel's first metre. Straight on with a
///   track of 1.2 m that is 0.7° and 0.07 m sideways after 10 m, 2.1° and 2.2 m after 100 m: the
///   order of what J. Borenstein and L. Feng (IEEE Trans. Robotics and Automation 12(6), 1996)
///   measured with calibrated wheels on smooth floor. A rough floor deserves more.
/// - Over a gap, kGapFactor times as much, because wheels that brake hard slip; and the turn may
///   have come before the way or after it: (d·a)²/12 sideways, as for any place in between.
/// - A wheel that may have turned by u without being counted: u²/3, as for any way from −u to u. So
///   much, too, after a jump, with what the wheel can turn at most.
class Odometry {
 public:
  /// From the vehicle's start pose on.
  struct State : DeadReckoning {
    Twist twist;  ///< twist by the newest valid wheel speeds; zero before and while invalid
  };

  static constexpr double kVariancePerMetre = DeadReckoning::kVariancePerMetre;  ///< k², m²/m
  static constexpr double kGapFactor = 10.0;
  /// Twice the longest control cycle.
  static constexpr Duration kGap = std::chrono::milliseconds{200};

  explicit Odometry(const VehicleConfig& vehicle);

  /// The wheels' newest feedback, left and right; once per control cycle.
  void update(const std::array<WheelFeedback, 2>& wheels);

  const State& state() const { return state_; }
  /// How many gaps were bridged by what the drives counted.
  std::int64_t gaps() const { return gaps_; }
  /// How often some way was not counted.
  std::int64_t reanchored() const { return reanchored_; }

 private:
  struct Anchor {
    double angle_rad = 0.0;
    double uncounted_rad = 0.0;
    Instant stamp{};
  };
  using PerWheel = std::array<double, 2>;

  double most_m(const WheelFeedback& wheel, const Anchor& anchor) const;
  void move(const PerWheel& rims_m, const PerWheel& variances_m2, bool gap);

  double radius_m_;
  double track_m_;
  double max_speed_mps_;
  State state_;
  std::array<Anchor, 2> anchors_;
  bool anchored_ = false;
  bool interrupted_ = false;  ///< feedback was not valid since the anchors
  std::int64_t gaps_ = 0;
  std::int64_t reanchored_ = 0;
};

}  // namespace tether
