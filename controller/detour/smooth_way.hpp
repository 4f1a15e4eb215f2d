#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "common/path/limits.hpp"
#include "common/path/planned_path.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// A part of a way: a turn on the spot, or a curve with a speed profile, from rest to rest.
struct WayLeg {
  Pose2 from;
  double turn_rad = 0.0;                    ///< on the spot, positive to the left; may be beyond π
  std::shared_ptr<const PlannedPath> path;  ///< null: it is a turn
};

/// How far it is from a vehicle to what stands nearest.
struct Room {
  double around_m = 0.0;  ///< from its outline
  double ahead_m = 0.0;   ///< from its outline with what it needs ahead
};
using RoomAt = std::function<Room(const Pose2&)>;

/// The sharpest bend of a smooth way where there is a choice: a radius of 0.67 m. The planner's
/// arcs have 1.15 m.
inline constexpr double kSharpestWay_1pm = 1.5;
/// By how much a smooth way may have less room than it should: what a grid of 0.1 m is off by.
inline constexpr double kLessRoom_m = 0.02;

/// Makes of a plan's poses what a vehicle can follow within `limits`: cubic splines (WaypointCurve)
/// through as few of the poses as keep the room, with a speed profile. Poses at one place are a
/// turn on the spot; between turns is one curve.
///
/// A curve goes through every fourth pose at first. Where it has less room than `enough_m`, or than
/// the tightest of the poses if that is less, or bends more than kSharpestWay_1pm, it goes through
/// more of them, at last through all and the middles of their arcs: that is the plan's own way, to
/// a few mm, with bends that do not jump. However it bends, the speed fits.
std::vector<WayLeg> smooth_way(const std::vector<Pose2>& plan, const PathLimits& limits,
                               const RoomAt& room_at, double enough_m);

}  // namespace tether
