#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/emulated/drivetrain.hpp"
#include "can_bridge/emulated/safety_inputs.hpp"
#include "can_bridge/emulated/wheel_model.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// The scenario sections that emulated drives use.
using DriveSettings = Sections<RunSettings, VehicleSettings, CanSettings>;

/// Emulated drives on a CAN bus, and their wheels.
///
/// From run.lead_s before t = 0 on, every millisecond: the drives' ramps and timers, and what they
/// have to send. Frames are answered at once.
///
/// Wheels, not standalone: SIM/WHEEL_TARGETS goes out every can.coupling_ms, also while the power
/// stages are off (then zero), so that the simulator may take silence for a dead drive; SIM/WHEELS
/// comes in. Before its first message the wheels stand at angle 0. When it has been silent for
/// kWheelTimeout the encoders keep their position and read speed zero. Messages that are
/// undecodable, non-finite, duplicated, late or stamped in the future are counted and otherwise
/// ignored.
///
/// Wheels, standalone: a WheelModel each, shown on SIM/WHEELS every can.coupling_ms.
///
/// Safety inputs on CAN are emulated, too, and are clear; but not with can.emulate_drives = false,
/// because no program may speak for a real scanner.
///
/// Faults come from the scenario (can.inject…, once at can.inject_at_s) and from CAN/INJECT; a
/// request of unknown kind, with an unusable value or for a node that is not there is counted and
/// ignored. A can.inject_node that the drivetrain has not is a UsageError.
class CanDriveNode final : public Node {
 public:
  static constexpr Duration kTick = std::chrono::milliseconds{1};
  /// Longer than in virtual time, because waking up costs more than the work. Frames are answered
  /// at once all the same.
  static constexpr Duration kRealTimeTick = std::chrono::milliseconds{5};
  static constexpr Duration kWheelTimeout = std::chrono::milliseconds{100};

  /// Everything handed in by reference must outlive the node, except scenario and config.
  CanDriveNode(const DriveSettings& settings, const DrivetrainConfig& config, EventLoop& loop,
               Bus& bus, CanPort& port);

  /// Publishes the final counters.
  void finish() override;

  const EmulatedDrivetrain& drives() const { return *drives_; }

 private:
  void subscribe_to_faults(const DriveSettings& settings);
  void subscribe_to_wheels();
  void tick();
  void turn_wheels(Instant now);
  void publish_wheels();
  void publish_targets();
  void on_frame(const CanFrame& frame);
  void on_wheels(Instant stamp, std::int64_t seq, const WheelStates& wheels);
  void on_fault_request(std::int32_t node, std::int32_t kind, double value);
  bool apply(std::int32_t node, std::int32_t kind, double value);
  void send_all();
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  CanPort& port_;
  ChannelNames channels_;
  bool standalone_;
  std::vector<std::uint8_t> nodes_;  // ids a fault may be for, in addition to 0
  std::unique_ptr<EmulatedDrivetrain> drives_;
  EmulatedSafetyInputs inputs_;
  std::array<WheelModel, 2> wheel_models_;
  StreamGuard wheel_guard_;
  StreamGuard fault_guard_;

  WheelStates wheels_;
  bool wheels_silent_ = true;
  Instant last_tick_{};
  Instant last_wheels_{};
  std::vector<CanFrame> out_;
  std::vector<CanFrame> sending_;

  std::int64_t wheels_seq_ = 0;
  std::int64_t targets_seq_ = 0;
  std::int64_t wheels_undecodable_ = 0;
  std::int64_t wheels_non_finite_ = 0;
  std::int64_t wheel_timeouts_ = 0;
  std::int64_t faults_undecodable_ = 0;
  std::int64_t faults_refused_ = 0;
  std::int64_t faults_injected_ = 0;
  CounterReporter counters_;
};

}  // namespace tether
