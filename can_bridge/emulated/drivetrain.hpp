#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/diff_drive.hpp"

namespace tether {

/// A fault to inject into an emulated drive.
struct DriveFault {
  enum class Kind : std::int32_t {
    none = 0,     ///< ends all but fault and reboot
    fault = 1,    ///< the drive trips; value: its error code (0: 0x7500)
    reboot = 2,   ///< power cycle: boot-up message, everything forgotten
    silence = 3,  ///< sends nothing any more, still hears (broken TX); value: seconds, 0: for good
    sdo_abort = 4,       ///< aborts all SDO access to object `value` (0x1016 …; 0: to all)
    encoder_freeze = 5,  ///< position and speed feedback stand still
    wheel_slip = 6,      ///< the wheel turns but `value` (0…1) of its motion is not the encoder's
    push = 8,  ///< a load accelerates wheels without power and brake by `value`, rad/s², forward
    weak_brake = 9,  ///< stops are acknowledged, and `value` (0…1) of the ramps acts
  };
  int node = 0;  ///< CANopen node id; 0: all drives
  Kind kind = Kind::none;
  double value = 0.0;
};

/// State of the wheels that the emulated drives turn.
struct WheelStates {
  std::array<double, 2> angle_rad{};  ///< left, right; unbounded, forward positive
  std::array<double, 2> speed_radps{};
};

/// Emulated drives of one vehicle, seen from the CAN bus: honest drives that ramp, watch over their
/// master and have faults. No I/O and no clock. The wheels themselves belong to the caller (ODE, or
/// a simple model): set_wheels() tells how they turn, wheel_targets() how the drives want them to
/// turn.
class EmulatedDrivetrain {
 public:
  virtual ~EmulatedDrivetrain() = default;

  virtual std::vector<CanFilter> filters() const = 0;
  /// May answer at once (SDO, SYNC): appends to `out`.
  virtual void on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out) = 0;
  /// Every millisecond: ramps, heartbeats, timers.
  virtual void tick(Instant now, std::vector<CanFrame>& out) = 0;
  virtual void set_wheels(const WheelStates& wheels) = 0;
  /// Angular speed that each drive's servo holds now; zero with the power stage off (a
  /// spring-applied brake holds the wheel).
  virtual std::array<double, 2> wheel_targets_radps() const = 0;
  virtual void inject(const DriveFault& fault, Instant now) = 0;
  /// Appends the drives' own counters, named "node1.emcy_sent" …, if it keeps any.
  virtual void list(CounterList& /*out*/) const {}
};

}  // namespace tether
