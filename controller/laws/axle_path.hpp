#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <vector>

#include "common/path/reference_path.hpp"

namespace tether {

/// How the axle's midpoint must move so that a point `ahead_m` > 0 ahead of it moves along another
/// path: for laws that are derived for the axle's midpoint. A body point with velocity V whose
/// wheels do not slip sideways turns the vehicle by
///   dθ/dt = V · n(θ) / a,   n(θ) = (−sin θ, cos θ),
/// because only the forward part of the axle's velocity is free (a = ahead_m; it follows from
/// p = axle + a (cos θ, sin θ)). While the path goes forward, θ forgets how it began at the rate
/// |V|/a: the vehicle's heading trails the path's by asin(a κ) where the curvature is κ.
///
/// θ is integrated once, by Runge-Kutta in steps of 10 ms from 20 s before t = 0 on, where θ is the
/// path's heading; so it is settled at t = 0 if the path moves before. Outside of that time and
/// beyond a day, θ is the path's own. Safe to share; the same answers whatever was asked before.
class AxlePath final : public ReferencePath {
 public:
  AxlePath(std::shared_ptr<const ReferencePath> path, double ahead_m);

  PathPoint at(double t_s) const override;

 private:
  double heading_at(double t_s, double path_yaw_rad) const;
  double turn_rate(const PathPoint& p, double heading_rad) const;
  void extend(std::size_t count) const;

  std::shared_ptr<const ReferencePath> path_;
  double ahead_m_;
  mutable std::mutex mutex_;
  mutable std::vector<double> headings_rad_;  ///< one a step, not wrapped
};

}  // namespace tether
