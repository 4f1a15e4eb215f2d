#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "can_bridge/agilex/config.hpp"
#include "can_bridge/agilex/v2.hpp"
#include "can_bridge/emulated/drivetrain.hpp"
#include "can_bridge/emulated/encoder.hpp"

namespace tether {

/// A chassis that speaks the AgileX protocol, version 2 (v2.hpp), seen from the bus: it
/// reports 0x211, 0x221, 0x251, 0x252 and 0x311 every 20 ms, follows 0x111 in CAN mode only, and
/// brakes when 0x111 stays away for 500 ms; then it stays in CAN mode and follows again when
/// commands return. An exception brakes it, too, and puts it into standby until 0x441.
///
/// No figures are published for the following, so they are assumed: ramps of 2 m/s² and 4 rad/s²,
/// 24.0 V, motor speed = wheel speed, 0.5 s from power-on to the first frame.
///
/// Faults: `fault` (value: 0x211's error code; 0: 0x0001), `reboot`, `silence`, `encoder_freeze`,
/// `wheel_slip`, `none`; it has no objects, so sdo_abort does nothing, and no node ids: whatever
/// the fault's node, it is this chassis.
class EmulatedAgilexV2 final : public EmulatedDrivetrain {
 public:
  /// Powered on at `now`.
  EmulatedAgilexV2(const AgilexV2Config& config, Instant now);

  std::vector<CanFilter> filters() const override;
  void on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out) override;
  void tick(Instant now, std::vector<CanFrame>& out) override;
  void set_wheels(const WheelStates& wheels) override;
  std::array<double, 2> wheel_targets_radps() const override;
  void inject(const DriveFault& fault, Instant now) override;

 private:
  bool running(Instant now) const { return now >= boots_until_; }
  void power_on(Instant now);
  void ramp(Instant now);
  void report(std::vector<CanFrame>& out);

  double wheel_radius_m_;
  double track_m_;

  agilex::SystemState state_;
  agilex::Motion command_;
  Instant commanded_at_{};
  Instant boots_until_{};
  Instant silent_until_{};
  Instant next_report_{};
  Instant ramped_at_{};
  Twist setpoint_;  // after ramps
  std::array<EmulatedEncoder, 2> encoders_;
};

}  // namespace tether
