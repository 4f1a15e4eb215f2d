#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <tether/plan_in_force_t.hpp>
#include <variant>
#include <vector>

#include "common/base/counters.hpp"
#include "common/fleet/fleet.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/node/sole_sender.hpp"
#include "common/node/stream_guard.hpp"
#include "common/path/path_settings.hpp"
#include "common/path/reference_path.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/actuator.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/plan.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/surroundings.hpp"
#include "sim/node/metrics.hpp"
#include "sim/node/traffic.hpp"
#include "sim/plant/drive_errors.hpp"
#include "sim/plant/plant.hpp"
#include "sim/sensor/lidar_model.hpp"
#include "sim/sensor/lidar_settings.hpp"
#include "sim/sensor/pose_sensor.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "sim/sensor/wheel_odometry.hpp"

namespace tether {

/// With drives on CAN only the bridge knows which plan the vehicle follows: it says so on CAN/PLAN,
/// and the sensor stamps its poses with the newest that it has heard. Before the first they name
/// none. Undecodable, duplicated and late messages are counted and change nothing.
class PlanWatch {
 public:
  /// `loop` and `bus` must outlive the watch.
  PlanWatch(const Sections<RunSettings, VehicleSettings>& settings, EventLoop& loop, Bus& bus)
      : guard_({.earliest = kStart - from_seconds(settings.get<RunSettings>().lead_s)}) {
    subscribe<plan_in_force_t>(bus, ChannelNames(settings.get<VehicleSettings>().name).can_plan,
                               kDeepQueue, undecodable_, [this, &loop](const plan_in_force_t& m) {
                                 if (!guard_.accept(loop.now(), from_utime(m.utime), m.seq)) return;
                                 plan_ = {m.session, m.id};
                               });
  }
  PlanWatch(const PlanWatch&) = delete;
  PlanWatch& operator=(const PlanWatch&) = delete;

  PlanName plan() const { return plan_; }

  /// Appends plan_in_force.….
  void list(CounterList& out) const {
    guard_.list("plan_in_force", out);
    out.emplace_back("plan_in_force.undecodable", undecodable_);
  }

 private:
  StreamGuard guard_;
  PlanName plan_;
  std::int64_t undecodable_ = 0;
};

using ScanSettings = Sections<RunSettings, WorldSettings, VehicleSettings, Surroundings,
                              LidarSettings, LocaliserSettings>;

/// The scanner's part of SimNode: AGV/SCAN, and with localiser.place = edge AGV/SCAN_PART, whenever
/// the last beam of a turn is measured. Turns begin at multiples of their period from t = 0 on, and
/// before.
class Scanning {
 public:
  /// The scanner must be on. `loop` and `bus` must outlive this.
  Scanning(const ScanSettings& settings, EventLoop& loop, Bus& bus);

  Duration period() const { return lidar_.period(); }
  /// From a turn's first beam to its last.
  Duration sweep() const { return lidar_.sweep(); }

  /// Where the vehicle was; times must ascend.
  void record(Instant when, const Pose2& pose) { track_.add(when, pose); }
  double range_max_m() const { return lidar_.range_max_m; }
  /// Publishes the turn whose last beam is measured at `end`. `others`: vehicles, as they are then.
  void publish_turn(Instant end, PlanName plan, std::vector<Shape> others = {});

 private:
  EventLoop& loop_;
  Bus& bus_;
  ChannelNames channels_;
  LidarSettings lidar_;
  Duration clock_offset_;
  MovingObstacles moving_;
  LidarModel model_;
  PoseTrack track_;
  bool in_parts_;
  std::size_t part_bytes_;
  std::int64_t part_seq_ = 0;
};

/// Lets emulated drives turn the simulated wheels: SIM/WHEEL_TARGETS in, SIM/WHEELS out
/// every can.coupling_ms, when the owner says so.
///
/// The newest target holds. Before the first, and without a new one for kTimeout, the target is
/// zero: the drives' process has died, so that spring-applied brakes would close. Undecodable,
/// non-finite and late targets are counted and refresh nothing.
class WheelCoupling {
 public:
  static constexpr Duration kTimeout = std::chrono::milliseconds{100};

  /// `vehicle`, `loop` and `bus` must outlive the coupling.
  WheelCoupling(const Sections<RunSettings, VehicleSettings>& settings, EventLoop& loop, Bus& bus,
                const Plant& vehicle);
  WheelCoupling(const WheelCoupling&) = delete;
  WheelCoupling& operator=(const WheelCoupling&) = delete;

  /// The rim speeds to hold at `now`.
  WheelSpeeds in_force(Instant now) const;

  /// SIM/WHEELS, as the vehicle is at `now`.
  void publish_wheels(Instant now);

  void list(CounterList& out) const;

 private:
  EventLoop& loop_;
  Bus& bus_;
  const Plant& vehicle_;
  std::string states_channel_;
  double wheel_radius_m_;
  StreamGuard guard_;
  WheelSpeeds targets_;
  Instant arrival_ = kStart;
  bool any_ = false;
  std::int64_t seq_ = 0;
  std::int64_t undecodable_ = 0;
  std::int64_t non_finite_ = 0;
};

/// The scenario sections that the vehicle side uses.
using SimSettings = Sections<RunSettings, WorldSettings, VehicleSettings, SensorSettings,
                             PathSettings, ActuatorSettings, Surroundings, LidarSettings,
                             LocaliserSettings, AutonomySettings, FleetSettings>;

/// The vehicle side: physics in steps of world.step_ms, AGV/POSE and, with sensor.odometry_rate_hz,
/// AGV/ODOMETRY out, AGV/CMD_VEL, AGV/PLAN and AGV/PRELOAD in, the truth on SIM/TRUTH and the run's
/// clock on SIM/CLOCK. With a laser scanner, scans (Scanning); with a localiser, which makes poses
/// of them, no AGV/POSE. With autonomy.enabled, twists come from it on AGV/DRIVE, instead of
/// commands and plans of the remote controller, and end in a stop after kDriveTimeout without
/// another.
/// With sensor.send = "changed", not all poses go out (PoseSending); the numbers of those that do
/// have no gaps.
///
/// Each step [t, t + step) uses the twist in force at t. A command therefore acts from the first
/// step that starts at or after its arrival. Commands that are undecodable, non-finite (or beyond
/// ±1e9), duplicated, late or stamped in the future are counted and otherwise ignored; they refresh
/// nothing. Plans are judged by the Actuator, as of their arrival. A pose names the plan that the
/// Actuator reports at the pose's stamp.
///
/// With vehicle.drivetrain = can, the CAN bridge takes the commands and the wheels follow emulated
/// drives (WheelCoupling); the bridge tells which plan is followed (PlanWatch).
///
/// The world moves in batches of steps, and before anything looks at it, so that there is no
/// observable difference. The metrics look at every tenth step; equal steps in between are taken at
/// once (Plant::take).
///
/// During the lead (run.lead_s before t = 0) poses and the clock flow and the vehicle stands. From
/// run.duration_s on there are no poses, and truth and metrics are final. The world stands still
/// then; with drives on CAN it goes on, so that they can be brought to a stop.
class SimNode final : public Node {
 public:
  static constexpr Duration kDriveTimeout = std::chrono::milliseconds{200};

  /// `traffic`: of a fleet, where this is one of the vehicles; it must outlive this. The first of
  /// them publishes the clock.
  SimNode(const SimSettings& settings, EventLoop& loop, Bus& bus, Traffic* traffic = nullptr);

  /// Publishes the final truth and counters.
  void finish() override;

  /// The vehicle as it is now.
  const Plant& vehicle() {
    advance(loop_.now());
    return *vehicle_;
  }
  const Metrics& metrics() const { return metrics_; }
  /// How often it met another vehicle of its fleet.
  std::int64_t collisions() const {
    return traffic_ == nullptr ? 0 : traffic_->collisions(number_in_traffic_);
  }

 private:
  void on_command(Instant stamp, std::int64_t seq, const Twist& twist);
  void subscribe_to_commands(bool autonomous);
  void take_commands(Instant until);
  PlanName plan_at(Instant stamp);
  void join(Traffic& traffic, const VehicleSettings& vehicle);
  void advance(Instant until);
  void make_steps(Instant until);
  std::int64_t take_steps(Instant last);
  std::int64_t equal_steps(Instant from, Instant last) const;
  void measure(const Plant::Steps& steps);
  WheelSpeeds wheel_targets(Instant from);
  void sample_pose(Instant now);
  void start_sensors(const SimSettings& settings);
  void scan(Instant now);
  void read_encoders();
  void publish_odometry(Instant now);
  void publish_clock(Instant now);
  void publish_truth();
  Position reference() const;
  Position controlled_point() const;
  double error_m() const;
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  // Members that each step needs are adjacent: of a fleet, many take turns in the caches.
  Duration step_;      ///< step of the physics
  Instant end_;        ///< end of truth and metrics
  Instant world_end_;  ///< end of motion
  Instant next_step_;
  Instant world_time_ = kStart;     ///< time of the vehicle's state
  Duration unmeasured_{0};          ///< since the last addition to the metrics
  Duration unmeasured_contact_{0};  ///< duration of it, at a wall
  Duration metrics_step_;
  bool may_be_equal_ = false;  ///< steps are not observed one by one, and targets stay
  std::unique_ptr<Plant> vehicle_;
  std::unique_ptr<WheelCoupling> drives_;    ///< with drives on CAN, instead of the actuator
  std::unique_ptr<Scanning> scanning_;       ///< with a laser scanner
  std::unique_ptr<WheelOdometry> odometry_;  ///< if it is sent
  std::shared_ptr<const ReferencePath> path_;
  double point_ahead_m_;  ///< offset from the axle of the point that follows the path
  struct ArrivedPlan {
    PlanSource source;
    Plan plan;
  };
  struct ArrivedCommand {
    Instant arrival;
    std::variant<Twist, ArrivedPlan> what;
  };
  std::vector<ArrivedCommand> arrived_;  ///< not in force before the next step that begins
  DriveErrors drive_errors_;
  Metrics metrics_;
  Actuator actuator_;

  ChannelNames channels_;
  SoleSender senders_;
  Duration sensor_latency_;
  Duration clock_offset_;                  ///< the vehicle's clock is ahead by this
  std::unique_ptr<PlanWatch> plan_watch_;  ///< with drives that follow plans
  PoseSensor sensor_;
  std::unique_ptr<PoseSending> pose_sending_;  ///< null: all poses are sent
  std::int64_t odometry_seq_ = 0;
  Traffic* traffic_ = nullptr;  ///< other vehicles of a fleet
  std::size_t number_in_traffic_ = 0;
  StreamGuard guard_;
  Instant last_truth_ = kStart;
  std::int64_t pose_seq_ = 0;
  std::int64_t dropped_poses_ = 0;
  std::int64_t truth_seq_ = 0;
  std::int64_t clock_seq_ = 0;
  Rejected rejected_;
  std::int64_t non_finite_ = 0;
  Rejected rejected_plans_;
  CounterReporter counters_;
};

/// The vehicle sides of all vehicles of a fleet, in one hall; of one vehicle, just its SimNode.
class SimFleet final : public Node {
 public:
  /// `members`: of fleet_members().
  SimFleet(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus);

  void finish() override { nodes_.finish(); }

  std::size_t size() const { return nodes_.size(); }
  SimNode& operator[](std::size_t i) { return nodes_[i]; }
  const SimNode& operator[](std::size_t i) const { return nodes_[i]; }

 private:
  std::optional<Traffic> traffic_;
  NodeGroup<SimNode> nodes_;
};

}  // namespace tether
