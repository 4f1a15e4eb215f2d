#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/scan.hpp"
#include "common/world/stopping_field.hpp"
#include "onboard/autonomy/swept_way.hpp"

namespace tether {

/// Where the vehicle was and is by its wheels: the odometry of the last kMemory, for moving scans
/// and poses from when they were measured to now. Pure; stamps ascend.
class MotionTrack {
 public:
  static constexpr Duration kMemory = std::chrono::seconds{2};
  /// Odometry that is older says nothing of the present.
  static constexpr Duration kReach = std::chrono::milliseconds{200};

  void add(Instant stamp, const Pose2& pose, const Twist& twist);

  /// In the odometry's own frame: between two messages on an arc, at most kReach beyond the newest;
  /// none for times that it does not know of.
  std::optional<Pose2> at(Instant when) const;
  /// Latest motion of the wheels, if it is no older than kReach.
  std::optional<Twist> twist(Instant now) const;
  /// A pose measured at `stamp`, moved on to `now`.
  std::optional<Pose2> moved_on(const Pose2& pose, Instant stamp, Instant now) const;

 private:
  struct Entry {
    Instant stamp;
    Pose2 pose;
    Twist twist;
  };
  std::deque<Entry> entries_;
};

/// Obstacles in the vehicle's way, from the newest scan and odometry alone: no map, no network.
/// Whatever returns light counts, whether it is in a map or not; what is beside the swept outline
/// (the vehicle's, wider by side_margin on each side) does not. Pure.
///
/// - Points within the vehicle's own outline are the vehicle.
/// - Where something is beside the vehicle already, nearer than the side margin, the margin is what
///   there is less kCloser_m: it can go on along it and leave, but comes no nearer.
/// - A scan that is missing, older than reaction_s at its end, or of which less than kLeastReturns
///   of the beams returned, says nothing: blind() tells why, and the clear way is 0. So it is with
///   odometry, without which a scan cannot be moved on to the present.
/// - The way counts as seen where the scanner looks along it: ahead, or behind when reversing.
class ObstacleField {
 public:
  /// Share of a scan's beams. A hall's walls may all be out of range but for a few; a scanner whose
  /// window is dirty or that looks into fog has none.
  static constexpr double kLeastReturns = 0.1;
  static constexpr double kCloser_m = 0.01;

  ObstacleField(const AutonomySettings& settings, const VehicleConfig& vehicle);

  /// A scan. `at_end`: where odometry had the vehicle at the scan's end; `twist`: what it did
  /// meanwhile, for which beams are corrected.
  void see(const Scan& scan, const Pose2& at_end, const Twist& twist);

  /// Before all questions: where odometry has the vehicle now; none if it does not say.
  void update(Instant now, const std::optional<Pose2>& odometry);

  /// Why nothing is known; "" if the present is known.
  const std::string& blind() const { return blind_; }

  /// Free way along the arc of `twist` from where the vehicle is now, for its present outline, up
  /// to the scanner's range; 0 if it does not see there.
  double clear_m(const Twist& twist) const;
  /// Whether the outline with its side margins is free at these poses, relative to the vehicle.
  bool is_way_free(const std::vector<Pose2>& poses) const;

  /// The points of the scan, in the vehicle's present frame; its own outline left out.
  const std::vector<Position>& points() const { return points_; }
  const Outline& outline() const { return outline_; }
  const StoppingField& stopping() const { return stopping_; }

 private:
  std::string why_blind(Instant now, const std::optional<Pose2>& odometry) const;
  bool looks(double direction_rad) const;
  double margin_beside_m() const;

  StoppingField stopping_;
  Outline outline_;
  double side_margin_m_;
  Outline wide_;  ///< with its present side margins
  Duration oldest_;

  bool any_scan_ = false;
  Instant scan_end_{};
  double returns_ = 0.0;  ///< share of the beams
  double range_m_ = 0.0;
  double first_rad_ = 0.0, last_rad_ = 0.0;  ///< the beams', vehicle's frame
  std::vector<Position> seen_;               ///< odometry's frame
  std::vector<Position> points_;
  std::string blind_ = "no scan";
};

}  // namespace tether
