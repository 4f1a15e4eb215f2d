// For .cpp files that compute with Eigen.
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "common/vehicle/dead_reckoning.hpp"
#include "common/vehicle/pose.hpp"
#include "common/world/scan.hpp"
#include "onboard/localiser/distance_field.hpp"
#include "onboard/localiser/odometry_track.hpp"

namespace tether {

inline Eigen::Matrix3d matrix_of(const PoseCovariance& p) {
  Eigen::Matrix3d m;
  m << p.x_x, p.x_y, p.x_yaw, p.x_y, p.y_y, p.y_yaw, p.x_yaw, p.y_yaw, p.yaw_yaw;
  return m;
}

/// Covariance from the upper triangle.
inline PoseCovariance covariance_from(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)};
}

/// A beam that hit something, in the vehicle's frame at one time: x forward, y left.
struct Beam {
  float x_m = 0.0F, y_m = 0.0F;          ///< position of the end
  float along_x = 1.0F, along_y = 0.0F;  ///< its direction, of length 1
  float share = 0.0F;                    ///< share of the scan's time at which it was measured
};

/// The beams of a scan that hit something within its range, at most `most` of its angles, evenly
/// chosen, as they would have been measured all at `when`. Each was measured from where the vehicle
/// was at its time by `odometry` (which may be empty: it stood); so a moving vehicle does not
/// distort the scan. What the wheels get wrong meanwhile matters least in the scan's middle().
std::vector<Beam> beams_of(const Scan& scan, const OdometryTrack& odometry, Instant when,
                           std::size_t most);

inline Instant middle(const Scan& scan) { return scan.stamp + (scan.end() - scan.stamp) / 2; }

/// Information of a measurement on a pose: the inverse of a covariance, in 1/m², 1/(m rad) and
/// 1/rad². It may be singular: then the measurement says nothing of some direction.
using PoseInformation = PoseCovariance;

/// The direction in which information says least of the position, whatever the yaw is, and what it
/// says of the yaw, wherever the vehicle is. Standard deviations, at most kNothing.
struct Weakness {
  static constexpr double kNothing = 1e3;
  double direction_rad = 0.0;  ///< world frame, in (−π/2, π/2]
  double sigma_m = kNothing;   ///< standard deviation of the position along it
  double yaw_sigma_rad = kNothing;
};
Weakness weakness(const PoseInformation& information);

/// The inverse of information that is not singular.
PoseCovariance covariance_of(const PoseInformation& information);

struct MatchSettings {
  double range_noise_m = 0.02;  ///< standard deviation of a beam along itself, white
  double map_noise_m = 0.001;   ///< noise of the outlines in the map, across them
  /// Maximum distance from the map of a beam's end; others are ignored, even at first.
  double max_distance_m = 0.5;
};

/// Result of matching a scan: the pose.
struct Match {
  Pose2 pose;
  PoseInformation information;
  /// The parts of it that beams of each slice of the scan's time gave.
  static constexpr std::size_t kSlices = 16;
  std::array<PoseInformation, kSlices> by_time{};
  int used = 0;             ///< beams that fit
  int outside = 0;          ///< beams that hit what is not in the map
  double residual_m = 0.0;  ///< root mean square of used beams' distances to the map
  int passes = 0;           ///< over all beams, that it took
  double fit = 0.0;         ///< mean of all beams' weights: 1 if all end on the map exactly

  double share() const {
    return used == 0 ? 0.0 : static_cast<double>(used) / static_cast<double>(used + outside);
  }
};

/// Where the vehicle is such that its beams end on the map's outlines, near `guess`.
///
/// Minimises the sum of squared distances, each over its variance: noise along a beam that meets an
/// outline at angle β from the outline's normal moves its end by cos β of it across the outline. So
/// beams that graze say most, as in the bound (censi.hpp). Gauss-Newton, damped (Levenberg), on
/// Tukey's biweight, which gives no weight to ends beyond 4.685 standard deviations (people, things
/// that are not in the map) and keeps 95 % of the efficiency (Holland & Welsch, Robust Regression
/// Using Iteratively Reweighted Least-Squares. Communications in Statistics A6, 1977; constant from
/// memory). The scale begins at max_distance_m and halves each step down to that of the noise,
/// which widens the basin.
///
/// The information is that of the beams with their weights; less if they are farther off than the
/// noise says. Directions of which it says nothing stay as guessed.
Match match_scan(const DistanceField& field, std::span<const Beam> beams, const Pose2& guess,
                 const MatchSettings& settings);

/// How many beams of a vehicle at `pose` went through what the map shows, by more than
/// `max_distance_m`: so it is not there. A beam that ends before that has met something new.
int beams_through_map(const DistanceField& field, std::span<const Beam> beams, const Pose2& pose,
                      double max_distance_m);

}  // namespace tether
