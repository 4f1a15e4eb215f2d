#pragma once

#include <algorithm>
#include <boost/random/normal_distribution.hpp>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/scan.hpp"
#include "common/world/shape.hpp"
#include "sim/sensor/lidar_settings.hpp"
#include "sim/sensor/ray_caster.hpp"

namespace tether {

/// Where the vehicle was in the last while: poses between which it moved straight and turned
/// evenly.
class PoseTrack {
 public:
  /// Times must ascend.
  void add(Instant when, const Pose2& pose) { points_.push_back({when, pose}); }
  bool empty() const { return points_.empty(); }

  /// Between two poses, or as the last two go on; before the first, that. `near` is where to look
  /// first, and then where it was found: 0 at first, for times that ascend. There must be a pose.
  Pose2 at(Instant when, std::size_t& near) const {
    if (points_.size() < 2 || when <= points_.front().when) return points_.front().pose;
    while (near + 2 < points_.size() && points_[near + 1].when < when) ++near;
    const Point &a = points_[near], &b = points_[near + 1];
    const double share = to_seconds(when - a.when) / to_seconds(b.when - a.when);
    return {a.pose.x_m + share * (b.pose.x_m - a.pose.x_m),
            a.pose.y_m + share * (b.pose.y_m - a.pose.y_m),
            a.pose.yaw_rad + share * wrap_angle(b.pose.yaw_rad - a.pose.yaw_rad)};
  }

  /// Forgets what no time from `when` on needs.
  void forget_before(Instant when) {
    const auto after = std::find_if(points_.begin(), points_.end(),
                                    [when](const Point& p) { return p.when > when; });
    const auto known = after - points_.begin(), most = std::ssize(points_) - 2;
    const auto forgotten = std::min(known - 1, most);
    if (forgotten > 0) points_.erase(points_.begin(), points_.begin() + forgotten);
  }

 private:
  struct Point {
    Instant when;
    Pose2 pose;
  };
  std::vector<Point> points_;
};

/// A laser scanner: turns where the vehicle was during a turn of the mirror, and what stands around
/// it, into a scan.
/// - Each beam is measured at its own time, from where the scanner is by then: a vehicle that moves
///   distorts the scan.
/// - A surface with reflectivity ρ that is met at the angle β from its normal at range r returns
///   light ∝ ρ cos β / r² (Lambert). The beam sees it if that is at least 0.1 / range_10_m², so up
///   to r = range_10_m √(10 ρ cos β), and between range_min_m and range_max_m.
/// - A beam of divergence_rad is three thirds, rays a third of it apart. If they meet more than one
///   shape, what is within kPulse_m behind the nearest is one echo, at its mean range weighted by
///   light: between them (a mixed pixel). Echoes with too little light are passed over.
/// - Range: plus Gaussian noise, rounded to range_step_m. Nothing seen: 0.
///
/// The n-th scan's random numbers depend on the seed and n only: streams "<vehicle>/lidar/noise"
/// and "<vehicle>/lidar/dropouts".
class LidarModel {
 public:
  static constexpr double kPulse_m = 0.5;  ///< assumed: half of what light goes in 3.3 ns

  LidarModel(const LidarSettings& settings, const VehicleConfig& vehicle,
             const std::vector<Shape>& standing, std::uint64_t seed, const std::string& name);

  /// The next turn, with the first beam at `first_beam`. `moving`: where shapes that move are then.
  /// Without name of a plan.
  Scan turn(Instant first_beam, const PoseTrack& track, const std::vector<Shape>& moving = {});

 private:
  void aim(const Scan& scan, const PoseTrack& track);
  double light(const RayFan& fan, std::size_t ray) const;
  double seen_range_m(std::size_t beam) const;
  double mixed_range_m(std::size_t beam) const;

  LidarSettings settings_;
  Pose2 mount_;
  std::vector<bool> hidden_;  ///< by beam
  RayCaster caster_;
  double least_light_;
  RandomEngine noise_random_, dropout_random_;
  boost::random::normal_distribution<double> normal_;
  RayFan middle_, right_, left_;  ///< right and left are empty without divergence
  std::int64_t seq_ = 0;
};

}  // namespace tether
