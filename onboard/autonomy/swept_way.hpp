#pragma once

#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// A vehicle seen from above, in its own frame (origin at the axle's midpoint, x forward): chassis
/// and wheels in one rectangle.
struct Outline {
  double rear_m = -0.5;  ///< x of its rear side
  double front_m = 1.5;
  double half_width_m = 0.6;

  bool contains(const Position& p) const {
    return p.x_m > rear_m && p.x_m < front_m && p.y_m > -half_width_m && p.y_m < half_width_m;
  }
  /// Distance of the axle's midpoint to the farthest corner.
  double reach_m() const;
  Outline wider_by(double side_m) const { return {rear_m, front_m, half_width_m + side_m}; }
  Outline longer_by(double ahead_m) const { return {rear_m, front_m + ahead_m, half_width_m}; }
};

Outline outline_of(const VehicleConfig& vehicle);

/// How fast the part of the vehicle moves that counts: max(|v|, |ω| · reach), so the axle on a way
/// and the farthest corner in a turn on the spot. A way's length is this times its time.
double pace_mps(const Twist& twist, const Outline& outline);

/// How far an outline that moves on with a constant twist gets until it meets `point`: as a way's
/// length (pace_mps), from where it is now. 0: the point is inside; infinity: it never does within
/// one turn, or the twist is zero. In closed form, by rotating the point about the centre of the
/// arc, which is at (0, v/ω), to where it enters the rectangle.
double way_until_m(const Position& point, const Outline& outline, const Twist& twist);

/// Whether the outline touches none of the points at any of these poses, all in one frame.
bool is_free(const std::vector<Position>& points, const Outline& outline,
             const std::vector<Pose2>& poses);

/// From the frame of `pose` to the frame that it is in, and back.
Position from_frame(const Pose2& pose, const Position& p);
Position into_frame(const Pose2& pose, const Position& p);

/// The pose after `dt_s` with a constant twist: an arc.
Pose2 moved(const Pose2& from, const Twist& twist, double dt_s);

}  // namespace tether
