#pragma once

#include <array>
#include <span>

#include "common/vehicle/pose.hpp"
#include "localiser/map/distance_field.hpp"
#include "localiser/matching/beams.hpp"
#include "localiser/matching/pose_information.hpp"

namespace tether {

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
