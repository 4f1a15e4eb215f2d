#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <tether/autonomy_state_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "can_bridge/commission/guard.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/node/estop_file.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "can_bridge/safety/gpio_inputs.hpp"
#include "can_bridge/safety/odometry.hpp"
#include "can_bridge/safety/safety_core.hpp"
#include "can_bridge/safety/safety_inputs.hpp"
#include "can_bridge/safety/transmit_whitelist.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/node/sole_sender.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/stopping_field.hpp"

namespace tether {

/// With autonomy the bridge takes AGV/DRIVE, and what AGV/AUTONOMY says of the clear way is a
/// demand beside those of the vehicle's safety inputs:
/// - no report for kFresh, or none yet: a stop, by the ramp, from which the vehicle goes on;
/// - the stopping field of the speed that its wheels have reaches beyond the clear way by more than
///   kBeyond_m: the same;
/// - else the speed limit of the clear way (StoppingField), for the faster rim, if it is below
///   can.max_speed_mps.
/// It is a second look at the same scan, by another program: no safety function.
///
/// Undecodable messages, those of other runs and late ones are counted and refresh nothing.
class AutonomyWatch {
 public:
  static constexpr Duration kFresh = std::chrono::milliseconds{300};
  /// A report is up to 0.1 s old and its field's way was seen then.
  static constexpr double kBeyond_m = 0.2;

  /// `loop` and `bus` must outlive the watch.
  AutonomyWatch(
      const Sections<RunSettings, VehicleSettings, CanSettings, AutonomySettings>& settings,
      EventLoop& loop, Bus& bus);
  AutonomyWatch(const AutonomyWatch&) = delete;
  AutonomyWatch& operator=(const AutonomyWatch&) = delete;

  /// Adds what it demands now of a vehicle whose wheels do `speed_mps`.
  void demand(Instant now, double speed_mps, SafetyDemands& all) const;

  /// Appends autonomy.….
  void list(CounterList& out) const;

 private:
  StoppingField stopping_;
  double max_speed_mps_;
  StreamGuard guard_;
  Rejected rejected_;
  std::optional<Instant> heard_;
  double clear_m_ = 0.0;
};

/// The scenario sections that the bridge and the emulated drives use.
using BridgeSettings =
    Sections<RunSettings, VehicleSettings, ActuatorSettings, CanSettings, AutonomySettings>;

/// The bridge between LCM and the drives: AGV/CMD_VEL, AGV/PLAN, AGV/PRELOAD and CAN/REQUEST in,
/// CAN frames out and in, CAN/STATE, CAN/WHEELS and CAN/ODOMETRY out in every control cycle (and
/// CAN/PLAN, with actuator.policy = "horizon"), CAN/COUNTERS every run.report_period_s. It only
/// translates: SafetyCore decides what may move.
///
/// A control cycle takes place every can.cycle_ms from the run's beginning (t = −run.lead_s) on, in
/// this order: decide, tell the profile, collect its frames, pass them through the
/// TransmitWhitelist, send. All frames leave in here, heartbeat and SYNC included: when this loop
/// hangs, the bus falls silent and the drives' watchdogs stop the vehicle.
///
/// Safety inputs (the drivetrain's [[safety_input]]) come by CAN or GPIO, without LCM, and are
/// handed to the SafetyCore in each cycle. Throws UsageError for GPIO lines in virtual time, and
/// for a CAN frame that is the drivetrain's own.
///
/// With autonomy.enabled it takes AGV/DRIVE instead of commands and plans, whose sender is on the
/// vehicle, and AutonomyWatch has a say.
///
/// Cycles that the loop missed are not made up for: only the newest sends ("cycle.slips" counts the
/// others). A cycle that is held up sends nothing more when its period is over ("tx.late" counts
/// these frames). Frames that arrive before the first cycle are ignored.
class CanBridgeNode final : public Node {
 public:
  CanBridgeNode(const BridgeSettings& settings, const DrivetrainConfig& config, EventLoop& loop,
                Bus& bus, CanPort& port);
  /// With a profile of the caller's, instead of the one that `config` names.
  CanBridgeNode(const BridgeSettings& settings, const DrivetrainConfig& config, EventLoop& loop,
                Bus& bus, CanPort& port, std::unique_ptr<DriveProfile> profile,
                const GpioOpener& open_gpio = open_gpiod_line);

  /// From now on the file remembers whether the e-stop is latched; if it says so already, the
  /// e-stop is pressed. Before the first cycle.
  void use_estop_file(EstopFile file);
  /// The e-stop is pressed from the start, and `why`. Before the first cycle.
  void restore_estop(std::string why) { safety_.restore_estop(std::move(why)); }
  /// State in the last cycle.
  bool estop_latched() const { return estop_latched_; }
  /// From now on it decides whether these drives may be armed. Before the first cycle.
  void use_commission_guard(CommissionGuard guard) { guard_ = std::move(guard); }

  /// Quick stop, standstill, power off; then nothing is sent any more. True when all that is done,
  /// or after SafetyCore::leave_wait().
  bool wind_down() override;

  /// Publishes the final counters. Throws std::runtime_error that tells the speed if after
  /// wind_down() wheels still turn or power is on.
  void finish() override;

 private:
  void on_command(const twist_t& message);
  void on_request(const drive_request_t& message);
  void on_frame(const CanFrame& frame);
  void on_cycle(Instant scheduled);
  void act(const Decision& decision, Instant now);
  void publish_state(const Decision& decision, Instant now);
  void publish_wheels(const DrivetrainSnapshot& drives, Instant now);
  void publish_odometry(Instant now);
  void publish_plan(Instant now);
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  CanPort& port_;
  ChannelNames channels_;
  SoleSender senders_;
  std::unique_ptr<DriveProfile> profile_;
  SafetyCore safety_;
  SafetyInputs inputs_;
  GpioInputs gpio_;
  std::optional<AutonomyWatch> autonomy_;  ///< with autonomy
  TransmitWhitelist whitelist_;
  Odometry odometry_;
  Duration cycle_;
  double wheel_radius_m_;
  bool takes_plans_;

  std::optional<EstopFile> estop_file_;
  bool estop_latched_ = false;
  std::optional<CommissionGuard> guard_;
  bool started_ = false;
  bool left_ = false;
  std::vector<CanFrame> frames_;
  std::int64_t cycles_ = 0;
  std::int64_t cycle_slips_ = 0;
  std::int64_t late_frames_ = 0;
  Rejected rejected_commands_;
  Rejected rejected_requests_;
  Rejected rejected_plans_;
  CounterReporter counters_;
};

}  // namespace tether
