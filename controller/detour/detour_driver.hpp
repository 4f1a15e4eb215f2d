#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/path/limits.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/shape.hpp"
#include "controller/detour/detour_planner.hpp"
#include "controller/detour/smooth_way.hpp"

namespace tether {

/// Obstacles that a vehicle reported since it asked for help: what it does not see any more,
/// while it goes around, still stands there. Cells of 0.1 m. Pure.
class ObstacleMemory {
 public:
  void clear() { seen_.clear(); }
  void add(Instant now, const std::vector<Position>& points);
  /// Forgets what was not reported since: it may have gone, and there is no way otherwise.
  void forget_before(Instant when);

  std::vector<Position> points() const;

 private:
  std::map<std::pair<std::int64_t, std::int64_t>, Instant> seen_;  ///< by cell: when last
};

/// A timed path by its arc length: how a vehicle says where it is on it
/// (autonomy_state_t::path_s_m). It learns the path's timing as far as it is asked. Not for several
/// threads.
class PathPlaces {
 public:
  static constexpr double kApart_m = 0.1;

  explicit PathPlaces(std::shared_ptr<const ReferencePath> path) : path_(std::move(path)) {}

  /// Poses from `from_m` on, kApart_m or less apart, for `length_m` or to the path's end.
  std::vector<Pose2> poses(double from_m, double length_m);
  /// Whether the path has its end by there.
  bool ends_by(double s_m);

 private:
  struct Place {
    double s_m;
    Pose2 pose;
  };
  void learn(double until_m);

  std::shared_ptr<const ReferencePath> path_;
  std::vector<Place> places_;
  double t_s_ = 0.0;
  bool ended_ = false;
};

/// Drives along a smooth way: turns on the spot follow the heading, curves are followed by pure
/// pursuit (Coulter: Implementation of the pure pursuit path tracking algorithm. CMU-RI-TR-92-01),
/// kAhead_m ahead, as fast as the profile says for where the vehicle is. Pure.
class WayFollower {
 public:
  static constexpr double kAhead_m = 0.75;
  static constexpr double kTurnGain = 1.0;  ///< 1/s
  static constexpr double kTurned_rad = 0.06;
  static constexpr double kReached_m = 0.1;  ///< distance to a curve's end
  static constexpr double kCreep_mps = 0.1;  ///< where the profile rests, and the vehicle must not
  static constexpr double kApart_m = 0.3;    ///< distance between poses of the way
  static constexpr double kTurnApart_rad = 0.25;

  WayFollower() = default;  ///< no way
  WayFollower(std::vector<WayLeg> legs, const PathLimits& limits);

  bool empty() const { return legs_.empty(); }

  /// The twist for a vehicle at `pose`, which goes on from where the last one was; zero at the end.
  Twist drive(const Pose2& pose);
  /// Whether it came to another leg, kApart_m or kTurnApart_rad farther since this was true last.
  bool made_headway();

  double off_m(const Pose2& pose) const;  ///< from the nearest place of the way
  std::vector<Pose2> ahead() const;       ///< rest of the way, kApart_m apart
  const std::vector<WayLeg>& legs() const { return legs_; }

 private:
  struct Place {
    double s_m, v_mps;
    Pose2 pose;
  };
  void pass_by(const Pose2& pose);
  bool has_turned(const Pose2& pose);
  bool has_arrived(const Pose2& pose);
  Twist turn() const;
  Twist pursue(const Pose2& pose) const;
  Position aim() const;
  double profile_mps() const;

  std::vector<WayLeg> legs_;
  std::vector<std::vector<Place>> places_;  ///< places of each leg; none for a turn; none of a turn
  double fastest_turn_radps_ = 0.0, creep_mps_ = 0.0;
  std::size_t leg_ = 0;
  std::size_t place_ = 0;    ///< place on the leg that is nearest to the vehicle
  double turned_rad_ = 0.0;  ///< progress of the leg
  std::size_t leg_then_ = 0;
  double way_then_ = 0.0;
};

/// A remote driver without a human: plans a way around what blocks the path, back onto it, and
/// drives the vehicle along it, slowly and within the path's limits (smooth_way, WayFollower).
/// Pure.
///
/// The way begins where the vehicle stands and ends on the path behind the first stretch that
/// something blocks, where there is room to take the vehicle back. What stands there: the map, and
/// all that the vehicle reported since it asked. It is planned again when something new is in the
/// way, when the vehicle is kOff_m beside it or makes no headway for kStuck, at most every
/// kPatience. Without a way it stands; kTries times in vain, and it forgets what is not reported
/// any more. What has been searched in vain is not searched again until something of it is another.
class DetourDriver {
 public:
  static constexpr double kOff_m = 0.5;
  static constexpr Duration kStuck = std::chrono::seconds{4};
  static constexpr Duration kPatience = std::chrono::seconds{1};
  static constexpr int kTries = 3;

  /// `path`: of the axle's midpoint; `limits`: its own. `mapped`: all that the map has.
  DetourDriver(const AutonomySettings& autonomy, const VehicleConfig& vehicle,
               std::shared_ptr<const ReferencePath> path, const PathLimits& limits,
               std::vector<Shape> mapped);

  /// Another request: all that was known is of the past.
  void begin();

  /// Takes the vehicle's report.
  void see(Instant now, const std::vector<Position>& obstacles, double path_s_m);

  /// The twist for a vehicle at `pose`; zero where it knows no way.
  Twist drive(Instant now, const Pose2& pose);

  /// Empty if there is none.
  const WayFollower& way() const { return way_; }
  /// Limits of its ways: those of the path, and those of the vehicle where they are less.
  const PathLimits& limits() const { return limits_; }
  /// Appends "detour.plans", "detour.none" (there was no way) and "detour.most_expansions".
  void list(CounterList& out) const;

 private:
  /// All that a plan depends on.
  struct Question {
    Pose2 start;
    double path_s_m;
    std::vector<Position> obstacles;

    bool operator==(const Question&) const = default;
  };

  FloorMap floor_around(const Pose2& pose) const;
  std::vector<Pose2> goals(const FloorMap& floor);
  bool needs_plan(Instant now, const Pose2& pose);
  bool is_obstructed(const Pose2& pose) const;
  void plan(Instant now, const Pose2& pose);
  void search(const Pose2& pose);

  DetourPlanner planner_;
  DetourPlanner looser_;  ///< for what is in the way of a plan that was made
  PathLimits limits_;
  PathPlaces path_;
  std::vector<Shape> mapped_;
  ObstacleMemory memory_;
  double path_s_m_ = 0.0;
  bool news_ = false;

  WayFollower way_;
  std::optional<Instant> planned_;
  std::optional<Question> hopeless_;
  Instant headway_{};
  int in_vain_ = 0;
  std::int64_t plans_ = 0, none_ = 0, most_expansions_ = 0;
};

}  // namespace tether
