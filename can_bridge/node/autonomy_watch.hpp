#pragma once

#include <optional>
#include <tether/autonomy_state_t.hpp>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/safety/safety_inputs.hpp"
#include "common/bus/channel_names.hpp"
#include "common/bus/message_io.hpp"
#include "common/bus/stream_guard.hpp"
#include "common/loop/event_loop.hpp"
#include "common/onboard/stopping_field.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

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

}  // namespace tether
