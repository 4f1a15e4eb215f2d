#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/reference_path.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator.hpp"
#include "common/vehicle/pose.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/scan.hpp"
#include "common/world/shape.hpp"
#include "common/world/surroundings.hpp"
#include "controller/laws/law.hpp"
#include "onboard/autonomy/obstacle_field.hpp"
#include "onboard/autonomy/supervisor.hpp"

namespace tether {

/// Unmapped obstacles of a scan: the points around the vehicle that are
/// not in the map, thinned out. Pure.
class SightedPoints {
 public:
  static constexpr double kRange_m = 8.0;   ///< from the axle's midpoint
  static constexpr double kMapped_m = 0.2;  ///< points nearer to a mapped shape belong to it
  static constexpr double kApart_m = 0.1;   ///< one point for each cell of this size

  /// `mapped`: all that the map has.
  explicit SightedPoints(const std::vector<Shape>& mapped);

  /// `points` in the vehicle's frame; the answer in the world's, at most `most`, the nearest first.
  std::vector<Position> unmapped(const std::vector<Position>& points, const Pose2& vehicle,
                                 std::size_t most) const;

 private:
  struct Known {
    Shape shape;
    double reach_m;  ///< from its centre
  };
  bool is_mapped(const Position& p) const;

  std::vector<Known> known_;
};

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

  /// `settings` with any law: its gains and limits are used for "tracking". Throws UsageError
  /// if a file of the path is wrong.
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

/// The scenario sections that driving uses.
using OnboardSettings = Sections<RunSettings, VehicleSettings, PathSettings, ControllerSettings,
                                 ActuatorSettings, AutonomySettings, WorldSettings, Surroundings>;

/// The vehicle as its own driver: field, law on board, remote driver's commands and supervisor put
/// together, and the setpoint that comes of it. Pure: what arrives and the vehicle's clock in,
/// setpoints out (autonomy_node translates).
///
/// In each step it moves pose and scan on to now, asks the law, and measures how far the way is
/// clear along the arcs of the setpoint and of the driver's command. The Supervisor decides who
/// drives. The setpoint moves towards the driver's command: no faster than the stopping field fits,
/// remotely no faster than remote_speed_mps, to zero without a driver.
class OnboardDriver {
 public:
  /// Slower than this it does not creep on towards an obstacle: the way is blocked.
  static constexpr double kCreep_mps = 0.05;
  /// Wheels that are faster than the field allows by more: a protective stop.
  static constexpr double kTooFast_mps = 0.1;
  /// Wheels that differ from the setpoint by more, for longer than kFollow: a protective stop. So
  /// it is when drives are not armed.
  static constexpr double kFollow_mps = 0.3;
  static constexpr Duration kFollow = std::chrono::milliseconds{500};
  /// Poses that within kCompared moved by more than kApart_m otherwise than the wheels: a
  /// protective stop. It is held by what its scanner does not see, slips, or does not know where it
  /// is.
  static constexpr double kApart_m = 0.4;
  static constexpr Duration kCompared = std::chrono::milliseconds{1500};
  /// How often it looks along its path while it does not follow it.
  static constexpr Duration kLook = std::chrono::milliseconds{100};
  /// Way beyond the stopping field that has to be free before the law on board goes on.
  static constexpr double kFreeBeyond_m = 1.0;

  struct Output {
    Twist setpoint;
    DriveState state = DriveState::autonomous;
    Driver driver = Driver::none;  ///< whose the setpoint is; none: it comes to rest, or stands
    std::optional<Pose2> pose;     ///< now, if localised
    double clear_m = 0.0;          ///< along where it drives, or would
    double field_m = 0.0;          ///< at this setpoint
  };

  explicit OnboardDriver(const OnboardSettings& settings);

  // Inputs, with its stamp by the vehicle's clock, in order; `now` by the same clock.
  void on_scan(const Scan& scan);
  void on_odometry(Instant stamp, const Pose2& pose, const Twist& twist);
  void on_pose(Instant stamp, const Pose2& pose);
  /// Whether the localiser knows where the vehicle is.
  void on_localisation(bool knows) { localiser_knows_ = knows; }
  void on_command(Instant now, Instant stamp, std::int64_t seq, const Twist& twist,
                  std::optional<Instant> report);
  void on_plan(Instant now, PlanSource source, Plan plan);
  void on_senders(bool several) { several_senders_ = several; }

  /// Once every 1/rate_hz.
  Output step(Instant now);

  const Supervisor& supervisor() const { return supervisor_; }
  const ObstacleField& field() const { return field_; }
  const PathFollower& follower() const { return follower_; }
  /// How late the vehicle is on its path.
  double late_s(Instant now) const;
  void list(CounterList& out) const;

 private:
  std::string unfit(Instant now);
  bool is_blocked(Instant now, const Twist& wanted) const;
  /// By speed and by position, both fresh.
  bool wheels_stand(Instant now) const;
  Twist wanted_by(Driver driver, Instant now, const Twist& law) const;
  std::optional<Pose2> pose_at(Instant now) const;
  void look_along_path(Instant now, const std::optional<Pose2>& pose);

  AutonomySettings settings_;
  Duration pose_timeout_;
  double step_s_;
  ObstacleField field_;
  MotionTrack track_;
  PathFollower follower_;
  Actuator remote_;
  Supervisor supervisor_;
  Setpoint setpoint_;

  struct Measured {
    Instant stamp;
    Pose2 pose;
  };
  std::deque<Measured> poses_;  ///< measurements of the last kCompared
  Instant apart_ =
      kStart - std::chrono::hours{24};  ///< when poses last moved otherwise than wheels
  struct Outlook {
    bool on_path = false;
    bool way_free = false;
    double place_s = 0.0;  ///< on the path
    Instant when = kStart - std::chrono::hours{24};
  };
  Outlook outlook_;
  bool localiser_knows_ = true;
  bool several_senders_ = false;
  Instant followed_{};  ///< when the wheels last did what the setpoint said
};

}  // namespace tether
