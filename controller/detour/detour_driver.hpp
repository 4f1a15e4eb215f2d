#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/onboard/onboard_settings.hpp"
#include "common/path/limits.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/shape.hpp"
#include "controller/detour/detour_planner.hpp"
#include "controller/detour/obstacle_memory.hpp"
#include "controller/detour/path_places.hpp"
#include "controller/detour/way_follower.hpp"

namespace tether {

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
