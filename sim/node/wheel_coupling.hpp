#pragma once

#include <cstdint>
#include <string>

#include "common/base/counters.hpp"
#include "common/bus/bus.hpp"
#include "common/bus/stream_guard.hpp"
#include "common/loop/event_loop.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/plant/plant.hpp"

namespace tether {

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

}  // namespace tether
