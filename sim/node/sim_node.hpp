#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "common/actuator/actuator.hpp"
#include "common/actuator/actuator_settings.hpp"
#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/bus/counter_reporter.hpp"
#include "common/bus/message_io.hpp"
#include "common/bus/sole_sender.hpp"
#include "common/bus/stream_guard.hpp"
#include "common/fleet/fleet.hpp"
#include "common/loop/event_loop.hpp"
#include "common/loop/node.hpp"
#include "common/onboard/onboard_settings.hpp"
#include "common/path/path_settings.hpp"
#include "common/path/reference_path.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "sim/lidar/lidar_settings.hpp"
#include "sim/node/metrics.hpp"
#include "sim/node/plan_watch.hpp"
#include "sim/node/scanning.hpp"
#include "sim/node/traffic.hpp"
#include "sim/node/wheel_coupling.hpp"
#include "sim/plant/drive_errors.hpp"
#include "sim/plant/plant.hpp"
#include "sim/sensor/pose_sending.hpp"
#include "sim/sensor/pose_sensor.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "sim/sensor/wheel_odometry.hpp"

namespace tether {

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

}  // namespace tether
