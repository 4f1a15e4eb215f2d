#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "can_bridge/cia402/drives.hpp"
#include "can_bridge/cia402/fault_latch.hpp"

namespace tether::cia402 {

/// Supervises that wheels which shall stop do brake. A drive may acknowledge a quick stop and brake
/// too weakly, or not at all: a ramp of 0x6085 that is a typing error, a chopper that is broken.
///
/// From the first tick of a stop on, each wheel whose power stage is on must be slowed down at half
/// of the required deceleration or more, from kGrace on; its speed is the faster of both witnesses.
/// Else the next step is taken, and supervised the same way:
/// 1. quick stop (or at once 2, Axes::stops_by_setpoint());
/// 2. target zero, with the power stage enabled;
/// 3. the bridge's heartbeat, SYNC and this node's setpoints are withheld, so that the drive's own
///    watchdog acts, until the wheel stands by both witnesses. No step is left after it.
/// Wheels without power coast, whatever is commanded; of these only text() tells.
class Braking {
 public:
  static constexpr Duration kGrace = std::chrono::milliseconds{150};

  explicit Braking(Drives& drives) : d_(drives) {}

  /// Deceleration of a wheel's rim that stops must reach half of; 0: not supervised.
  void require(double deceleration_mps2) {
    required_mps2_ = deceleration_mps2;
    d_.axes.require_deceleration(deceleration_mps2 / d_.axes.wheel_radius_m());
  }

  /// In every tick; `stopping`: the wheels shall stop. A step that is taken is a fault.
  std::optional<Fault> tick(Instant now, bool stopping);

  /// Whether heartbeat and SYNC must not be sent; and: the setpoints of this node.
  bool withholds() const;
  bool withholds_from(std::uint8_t node) const;
  /// For reasons; "" while all that shall brake does, as far as is known.
  std::string text() const;
  /// How many steps were taken.
  std::int64_t escalations() const { return escalations_; }

 private:
  enum class Step { quick_stop, setpoint, withheld };
  struct Watch {
    std::optional<Instant> since;  // beginning of the step
    Duration grace{};
    double from_radps = 0.0;
    Step step = Step::quick_stop;
    bool failed = false;   // the last step, or a wheel without power that coasts
    bool powered = false;  // when it failed
    double now_radps = 0.0;
  };

  std::optional<Fault> watch(std::size_t i, Instant now);
  void begin(std::size_t i, Step step, double speed_radps, Instant now);
  Duration watchdog_time(std::uint8_t node) const;
  std::string name_of(Step step) const;

  Drives& d_;
  double required_mps2_ = 0.0;
  std::array<Watch, 2> watches_;
  std::int64_t escalations_ = 0;
};

}  // namespace tether::cia402
