#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/agilex/config.hpp"
#include "can_bridge/agilex/v2.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/safety/wheel_motion.hpp"

namespace tether {

/// A chassis that speaks the AgileX protocol, version 2 (v2.hpp). It takes body twists and
/// has no power stages to switch: "standby" is its standby mode, "enabled" its CAN command mode.
///
/// - start(): waits for 0x211, 0x221 and 0x311. A chassis that is in CAN mode already is braked to
///   standstill and put into standby first.
/// - enabling: 0x421 = 1, repeated every 100 ms, with zero motion commands, until 0x211 shows it.
/// - enabled: 0x111 in every tick. v and ω are rounded to mm/s and mrad/s; beyond ±32.7 both are
///   scaled together.
/// - stopping: zero motion commands until standstill, then 0x421 = 0; after 3 s also where no
///   witness says that a wheel turns. The chassis has no harder brake than its own ramp. With
///   StopKind::disable, 0x421 = 0 is sent at once, unless a wheel turns.
/// - faulted: exception or emergency stop in 0x211, remote control taking over, silence for
///   feedback_timeout_ms, a way that jumps by more than a metre (the chassis restarted), time-out
///   of a mode change, a motion, mode or clearing command of another sender. While faulted it is
///   braked and put into standby.
/// - reset_fault(): sends 0x441 until the exception is gone, at most step_timeout_ms.
///
/// Watchdog: the chassis stops when 0x111 stays away for 500 ms (manual); nothing to set or check.
///
/// A chassis does not tell that it has restarted. After a silence its odometer is believed if the
/// wheels can have gone that far (a metre more than twice what 0x221 said before), and if it is not
/// within a metre of zero, where a restarted one begins. Else the way goes on from where it was,
/// and what the speed of before would have made of it in up to 10 s counts as not counted.
///
/// Standstill takes both witnesses of each wheel (WheelMotion): speeds of 0x221, ways of 0x311.
///
/// Wheel feedback: angles from 0x311, speeds from 0x221. `position_counts` are mm, `statusword` is
/// 0x211's bytes 0 and 1, `error_code` its bytes 4 and 5, the same for both wheels.
class AgilexV2Profile final : public DriveProfile {
 public:
  /// The vehicle's figures. Throws UsageError where they differ from the chassis' by more than 1 %.
  AgilexV2Profile(const AgilexV2Config& config, double wheel_radius_m, double track_m);

  std::vector<CanFilter> filters() const override;
  void start(Instant now) override;
  void on_frame(const CanFrame& frame, Instant now) override;
  void tick(Instant now, std::vector<CanFrame>& out) override;
  void set_command(const Twist& twist) override;
  void enable() override;
  void stop(StopKind kind) override;
  void distrust_standstill(Instant until) override { standstill_from_ = until; }
  void reset_fault() override;
  DrivetrainSnapshot snapshot(Instant now) const override;
  Counters counters() const override { return counters_; }
  std::string intruder() const override { return intruder_; }

 private:
  void enter(DrivePhase phase, std::string reason = "");
  void fault(std::string reason) { enter(DrivePhase::faulted, std::move(reason)); }
  void on_intruder(std::uint32_t id);
  void on_odometry(const agilex::Odometry& odometry, Instant now);

  void tick_starting(Instant now, std::vector<CanFrame>& out);
  void tick_enabling(Instant now, std::vector<CanFrame>& out);
  void tick_stopping(Instant now, std::vector<CanFrame>& out);
  /// Faults that can come at any time once the chassis has been started.
  void supervise(Instant now);
  /// Zero commands until standstill, then standby mode; true when the chassis is there.
  bool bring_to_standby(Instant now, bool brake_first, std::vector<CanFrame>& out);
  /// Sends a frame at most every 100 ms.
  void repeat(Instant now, const CanFrame& frame, std::vector<CanFrame>& out);

  bool heard_lately(const std::optional<Instant>& stamp, Instant now) const;
  bool feedback_fresh(Instant now) const;
  bool standstill(Instant now) const;
  bool turning(Instant now) const;
  std::string missing(Instant now) const;
  std::array<double, 2> wheel_speeds_radps() const;
  bool lasts(Instant now, int milliseconds) const;

  AgilexV2Config config_;
  double wheel_radius_m_;
  double track_m_;

  DrivePhase phase_ = DrivePhase::starting;
  std::string reason_;
  std::optional<Instant> entered_;   // the present phase; from its first tick on
  std::optional<Instant> repeated_;  // when repeat() last sent, in this phase
  bool clear_errors_ = false;        // in `starting`
  StopKind stop_kind_ = StopKind::quick;
  Instant standstill_from_ = Instant::min();  // until then, standstill is not believed
  agilex::Motion command_;

  std::optional<Instant> state_stamp_, motion_stamp_, odometry_stamp_;
  agilex::SystemState state_;
  agilex::Motion motion_;
  agilex::Odometry odometry_;             // raw, as last received
  std::array<std::int64_t, 2> way_mm_{};  // unwrapped, since construction
  std::array<WheelMotion, 2> wheels_motion_;
  double counted_speed_mps_ = 0.0;  // speed of the faster wheel, at the newest odometer
  double uncounted_m_ = 0.0;        // uncounted travel of either wheel

  Counters counters_;
  std::string intruder_;
};

}  // namespace tether
