#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "controller/laws/law.hpp"

namespace tether {

/// The law on board: a law of controller/laws (tracking) on the scenario's path, by a clock of its
/// own that starts at t = 0 and goes on only as the vehicle does. So the reference waits while the
/// vehicle stands, goes slowly while it is slowed, and never jumps ahead; the vehicle is late on
/// its path by what that took (late_s). Pure.
class PathFollower {
 public:
  static constexpr double kOnPath_m = 0.3;
  static constexpr double kOnPath_rad = 0.35;
  /// How far ahead the path is searched for where the vehicle could return to it.
  static constexpr double kSearch_s = 90.0;

  /// `settings` with any law: its gains and limits are used for "tracking". Throws UsageError for
  /// what is wrong with the path's files.
  explicit PathFollower(const LawSettings& settings);

  /// The twist for a vehicle at `pose` whose reference is at a time of the path. It never reverses:
  /// where the reference is behind, the vehicle waits for it.
  Twist wanted(const Pose2& pose, double path_s);
  Twist wanted(const Pose2& pose) { return wanted(pose, clock_s_); }

  /// `dt_s` went by, with a setpoint of `v_mps`: the clock goes on at the share of the path's own
  /// speed that the vehicle has, at most 1.
  void advance(double dt_s, double v_mps);

  /// The first time on the path, from the clock's on and within kSearch_s, at which the vehicle is
  /// on it: no farther than kOnPath_m and kOnPath_rad off, and as near as it gets there.
  std::optional<double> place_of(const Pose2& pose) const;
  /// Sets the clock to such a time.
  void go_to(double path_s);

  /// Poses of the path from `path_s` on, for `length_m` or to its end, in steps of 0.1 s.
  std::vector<Pose2> way(double path_s, double length_m) const;

  double clock_s() const { return clock_s_; }
  double way_m() const { return way_m_; }  ///< arc length up to the clock's time
  PathPoint reference() const { return path_->at(clock_s_); }
  double speed_mps(double path_s) const { return path_->at(path_s).v_mps; }

 private:
  std::shared_ptr<const ReferencePath> path_;  ///< path of the axle's midpoint
  std::unique_ptr<Law> law_;
  double clock_s_ = 0.0;
  double way_m_ = 0.0;
};

/// The path of the axle's midpoint that [path] means.
std::shared_ptr<const ReferencePath> axle_path(
    const Sections<PathSettings, VehicleSettings>& settings);

}  // namespace tether
