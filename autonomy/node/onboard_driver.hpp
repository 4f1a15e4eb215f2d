#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "autonomy/field/motion_track.hpp"
#include "autonomy/field/obstacle_field.hpp"
#include "autonomy/follow/path_follower.hpp"
#include "autonomy/supervisor/setpoint.hpp"
#include "autonomy/supervisor/supervisor.hpp"
#include "common/actuator/actuator.hpp"
#include "common/onboard/onboard_settings.hpp"
#include "common/onboard/scan.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/world/surroundings.hpp"

namespace tether {

/// The scenario sections that driving uses.
using OnboardSettings = Sections<RunSettings, VehicleSettings, PathSettings, ControllerSettings,
                                 ActuatorSettings, AutonomySettings, WorldSettings, Surroundings>;

/// The vehicle as its own driver: field, law on board, remote driver's commands and supervisor put
/// together, and the setpoint that comes of it. Pure: what arrives and the vehicle's clock in,
/// setpoints out (autonomy/node translates).
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
