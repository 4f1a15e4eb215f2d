#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/base/random.hpp"
#include "common/path/reference_path.hpp"
#include "onboard/localiser/distance_field.hpp"
#include "onboard/localiser/scan_match.hpp"

namespace tether {

/// Where the vehicle may be, if nothing is known: a particle filter on the likelihood field
/// (Thrun, Burgard, Fox: Probabilistic Robotics. MIT Press, 2005, sections 6.4 and 8.3; new
/// particles as in its augmented form). Particles that climb to the next maximum of the likelihood
/// by match_scan() stand for all around it, so that few have to be kept.
///
/// Each scan, from coarse to fine:
/// 1. `draws` new particles, stratified over all free places and yaws (so that all is seen once
///    in a sweep, whose length sweep_scans() says), are weighed by few beams on a coarse field.
/// 2. The best of them climb, with more beams.
/// 3. They join those kept, which moved with the odometry and climb, too. Those that meet are one;
///    the heaviest remain. A particle's weight is how well scans fit there, over its last scans.
///
/// The vehicle is found when all places were looked at twice, one particle fits well for some
/// scans, and none elsewhere fits nearly as well. In a hall that looks the same from two places it
/// is never found: its driver has to move it.
class PoseSearch {
 public:
  struct Settings {
    int draws = 20000;  ///< number of new particles per scan
    MatchSettings match;
    Position
        inside;  ///< a place that the vehicle can reach, and from it all others where it may be
  };

  PoseSearch(std::shared_ptr<const DistanceField> field, const Settings& settings,
             RandomEngine random);

  /// Starts afresh.
  void begin();
  /// Looks there, too.
  void suggest(const Pose2& pose);
  /// The vehicle moved: `step` is where it is in the frame of where it was.
  void move(const Pose2& step);
  /// Takes a scan; where the vehicle is, if that is clear now.
  std::optional<Match> look(std::span<const Beam> beams);

  /// Scans until all places were looked at.
  int sweep_scans() const;
  /// The best particle so far; nullopt if there is none.
  std::optional<Pose2> best() const;

 private:
  struct Particle {
    Pose2 pose;
    double fit = 0.0;  ///< mean of the last scans
    int scans = 0;
  };
  struct Drawn {
    Pose2 pose;
    float weight;
  };

  void find_places();
  void keep_what_can_be_reached(std::vector<bool>& is_free, int columns) const;
  float coarse_weight(const Pose2& place, std::span<const Beam> turned, float best) const;
  std::vector<Drawn> draw(std::span<const Beam> beams);
  void climb(Particle& particle, std::span<const Beam> beams, double reach_m) const;
  void keep_the_heaviest();
  std::optional<Match> clear_winner(std::span<const Beam> beams) const;

  std::shared_ptr<const DistanceField> field_;
  Settings settings_;
  RandomEngine random_;
  std::vector<Pose2> places_;  ///< free ones, in random order; yaw is 0
  std::vector<float> coarse_;  ///< weights of beams that end there
  std::size_t coarse_columns_ = 0, coarse_rows_ = 0;

  std::vector<Particle> particles_;  ///< the heaviest first
  std::size_t next_place_ = 0;
  std::size_t looked_at_ = 0;  ///< places, since the beginning
};

}  // namespace tether
