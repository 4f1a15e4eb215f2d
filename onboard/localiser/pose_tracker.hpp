#pragma once

#include <Eigen/Core>

#include "common/vehicle/dead_reckoning.hpp"
#include "onboard/localiser/odometry_track.hpp"
#include "onboard/localiser/scan_match.hpp"

namespace tether {

/// Where the vehicle is, by odometry and matches: an extended Kalman filter of x, y and yaw
/// (Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation. Wiley,
/// 2001, section 10.3).
///
/// Odometry moves it (DeadReckoning): each wheel's way is uncertain by itself, as a random walk,
/// and as much the vehicle's way aside: tyres slip in curves, which no encoder sees.
///
/// That also bends a scan that took some way: beams are off by what the wheels got wrong between
/// them and the scan's middle. An increment of the walk with covariance Q moves all beams beyond
/// it, whose information is B. So Λ z, with Λ the information of all beams, has beside their noise
/// Λ that of the bend, Σ B Q B over all increments; and it is correlated with the motion, each of
/// whose increments has ∓Q B with it before and after the middle: a scan is of where the vehicle
/// was on average.
///
/// A match corrects the state by Λ z. With the noise N of it, C its covariance with the motion
/// before, and S = Λ P Λ + Λ C + Cᵀ Λ + N, the gain is K = (P Λ + C) S⁻¹, and P⁺ = P − K S Kᵀ: a
/// filter whose noises are correlated (ibid., chapter 8). Where Λ is singular, nothing is taken
/// from z. What K took of the motion after the middle, the next move() allows for. A match whose
/// normalised innovation squared is beyond kGate, which happens to one of 1000 if all is as
/// assumed, is not used.
///
/// Pure. The caller reports by move() the wheels' motion in between.
class PoseTracker {
 public:
  static constexpr double kGate = 16.266;  ///< 0.999 quantile of χ², 3 degrees of freedom

  struct Settings {
    double track_m = 1.0;
    /// Standard deviation of a wheel's travel after 1 m; it grows as √.
    double wheel_noise_m = 0.01;
  };

  PoseTracker(const Settings& settings, const Pose2& pose, const PoseCovariance& covariance)
      : settings_(settings), state_{pose, covariance, 0.0} {}

  /// The wheels went from one point to the other. What is beyond the last reading is a guess, off
  /// by what the vehicle may have accelerated.
  void move(const OdometryTrack::Point& from, const OdometryTrack::Point& to);
  /// Position (each axis) and yaw are less well known, by these standard deviations.
  void widen(double position_m, double yaw_rad);
  /// Whether the match was used. Its scan began and ended at these points, and it is of the middle
  /// between them; without them, of a vehicle that stood.
  bool correct(const Match& match, const OdometryTrack::Point& began = {},
               const OdometryTrack::Point& ended = {});

  const Pose2& pose() const { return state_.pose; }
  const PoseCovariance& covariance() const { return state_.covariance; }
  /// The longer axis of its ellipse.
  double position_sigma_m() const;
  double last_nis() const { return last_nis_; }

 private:
  void roll(DeadReckoning& state, const Pose2& step, double distance_m) const;

  Settings settings_;
  DeadReckoning state_;
  Eigen::Matrix3d known_ahead_ = Eigen::Matrix3d::Zero();  ///< −cov(state, motion after the scan)
  double last_nis_ = 0.0;
};

}  // namespace tether
