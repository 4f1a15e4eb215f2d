#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/path/path_settings.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/dead_reckoning.hpp"
#include "common/vehicle/plan.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/surroundings.hpp"
#include "controller/laws/controller_settings.hpp"

namespace tether {

/// A pose as the controller got it.
struct SeenPose {
  Pose2 pose;
  Instant stamp{};    ///< time of the measurement
  Instant arrival{};  ///< here
  std::int64_t seq = 0;
  /// The id of the newest plan that the vehicle had accepted by `stamp`; it follows that plan from
  /// the plan's start on. nullopt: no plan of this controller.
  std::optional<std::int64_t> plan_id;
  bool follows_other = false;  ///< it follows a plan of another controller, or of another start
  /// Motion of the wheels at `stamp`, where FilteredLaw knows it from odometry.
  std::optional<Twist> rolling = std::nullopt;
};

/// The vehicle's odometry, as the controller received it (odometry_t): where it is by dead
/// reckoning from its nominal start pose, which is not where sensors say that it is.
struct SeenOdometry {
  DeadReckoning reckoning;
  Twist twist;        ///< by the wheels' speeds
  Instant stamp{};    ///< time of the encoders' reading
  Instant arrival{};  ///< here
  std::int64_t seq = 0;
};

/// State of a vehicle that drives by itself, as the controller received it (autonomy_state_t).
struct SeenAutonomy {
  bool asks = false;    ///< for a remote driver, or has one: REMOTE_REQUESTED or REMOTE
  bool driven = false;  ///< REMOTE: it follows what this controller commands
  std::int64_t handover = 0;
  double path_s_m = 0.0;            ///< arc length on the path that it will return to
  std::vector<Position> obstacles;  ///< world frame; of those that are not in the map
  Instant stamp{};
  Instant arrival{};  ///< here
};

/// Decision of a law: the twist to follow from now on, or a plan. Of a plan's fields, the node
/// fills in stamp, seq and name.session. Ids ascend by 1 from 0.
using LawOutput = std::variant<Twist, Plan>;

/// The vehicle against the reference point that the law aims at, for reports.
struct LawErrors {
  double heading_rad = 0.0;  ///< from the vehicle's heading to the direction of that point
  double distance_m = 0.0;
};

/// A control law. It is pure: it gets all that it knows as arguments. ControllerNode asks it for a
/// decision at each pose or at a rate, and sees to messages, time-outs and output that is not
/// finite.
class Law {
 public:
  virtual ~Law() = default;

  /// Each accepted pose, stamps ascending.
  virtual void on_pose(const SeenPose&) {}

  /// Each accepted odometry message, stamps ascending. None with sensor.odometry_rate_hz = 0.
  virtual void on_odometry(const SeenOdometry&) {}

  /// Each accepted report of a vehicle that drives by itself, stamps ascending. None with
  /// autonomy.enabled = false.
  virtual void on_autonomy(const SeenAutonomy&) {}

  /// The decision at `now`, which does not decrease from call to call. `newest`: the pose that
  /// on_pose() had last; only laws that plan ahead are asked without one, and before t = 0.
  virtual LawOutput decide(Instant now, const SeenPose* newest) = 0;

  /// Output that is sent at `now` in place of a decision: before t = 0, after a pose time-out, or
  /// instead of an unusable decision. All that the law integrates starts afresh.
  virtual LawOutput stop(Instant) {
    reset();
    return Twist{};
  }
  virtual void reset() {}

  /// Sets the look-ahead τ for its next decisions (LawKind::looks_ahead).
  virtual void set_look_ahead(double) {}

  /// Whether it decides before the first pose and before t = 0.
  virtual bool plans_ahead() const { return false; }
  /// The plan to be on board at t = 0; asked once, before all else.
  virtual std::optional<Plan> preload() { return std::nullopt; }

  /// The errors at the last decision.
  virtual LawErrors errors() const = 0;
  virtual void list_counters(CounterList&) const {}
};

/// The sections that laws may know.
using LawSettings = Sections<ControllerSettings, VehicleSettings, ActuatorSettings, PathSettings,
                             AutonomySettings, WorldSettings, Surroundings>;

/// Construction arguments of laws.
struct LawContext {
  LawSettings settings;
  /// Path of the point that is `ahead_m` ahead of the axle's midpoint.
  std::shared_ptr<const ReferencePath> path;
  double ahead_m = 0.0;
};

/// Context for a law that uses LawContext::ahead_m (`steers_any_point`), or that is derived only
/// for the axle.
LawContext law_context(const LawSettings& settings, bool steers_any_point);

/// One of the values of controller.law. A new one is a file with a function <name>_law() that
/// returns its row, and a line in law.cpp.
struct LawKind {
  std::string name;
  bool sends_plans = false;  ///< instead of twists
  /// Whether it is the remote driver of a vehicle that drives by itself (autonomy.enabled), and
  /// nothing else.
  bool drives_on_request = false;
  /// Whether it heeds LawContext::ahead_m. All others are derived for the axle's midpoint: with
  /// path.point = "chassis" they get the axle's path that takes the chassis' centre along that of
  /// the scenario (AxlePath), and their errors are those to this one.
  bool steers_any_point = false;
  bool looks_ahead = false;  ///< by controller.tau_s, and nothing else
  /// Keys of [controller], or their beginnings, without "controller.", that this law uses but not
  /// every law.
  std::vector<std::string> keys;
  /// Throws UsageError for what is wrong with its files.
  std::unique_ptr<Law> (*make)(const LawContext&);
  /// Checks conditions on several keys together. Throws UsageError that begins with `file`.
  void (*check)(const ControllerSettings&, const std::string& file) = nullptr;
  std::vector<ScenarioKey> own_keys = {};  ///< keys of ControllerSettings::own; also among `keys`
};

/// All laws, in the order in which messages name them.
const std::vector<LawKind>& law_kinds();
const LawKind& kind_of(const ControllerSettings& settings);

/// The law that controller.law names. Throws UsageError for what is wrong with its files.
std::unique_ptr<Law> make_law(const LawSettings& settings);

}  // namespace tether
