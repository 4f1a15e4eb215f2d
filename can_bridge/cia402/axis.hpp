#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/pdo.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/safety/wheel_motion.hpp"

namespace tether::cia402 {

/// One wheel's axis of a CiA 402 drive: what it reported, in SI units, and which controlword comes
/// next. Pure.
class Axis {
 public:
  /// `name`: for reasons. `feedback_timeout`: age from which feedback is not fresh any more.
  /// `standstill_radps`: wheels slower than this stand.
  Axis(const AxisConfig& config, std::string name, Duration feedback_timeout,
       double standstill_radps);

  /// A new start: forgets what the drive reported. The angle stays where it is.
  void begin();

  /// From now on the drive's encoder may start anywhere: the next position continues the present
  /// angle. What the wheel may have turned since the newest position counts as not counted
  /// (WheelFeedback::uncounted_rad): at the speed of then + standstill_radps, for 10 s at most, in
  /// which wheels without power have rolled out.
  void reanchor() {
    anchored_ = false;
    motion_.forget_position();
  }

  /// The position of a drive whose feedback was silent, as read by SDO while its wheel stood, and
  /// which is known not to have rebooted since: what it counted meanwhile is taken up.
  void take_up(std::int64_t raw, Instant now);

  /// A position that was read by SDO: a witness of motion, and nothing more. Its drive may have
  /// rebooted, so it is not counted.
  void see_position(std::int64_t raw, Instant now);

  // --- from the drive
  void receive(const PdoMap::Field& field, std::int64_t value, Instant now);
  void on_emergency(std::uint16_t code) { emergency_code_ = code; }

  // --- to the drive
  /// The controlword that leaves now. After a change only a statusword and a speed received later
  /// confirm anything: an older one could be from before an earlier change.
  void command(std::uint16_t controlword);
  std::uint16_t controlword() const { return controlword_; }
  /// Another sender may have commanded it: only what is received later confirms anything.
  void doubt() { status_confirms_ = speed_confirms_ = position_confirms_ = false; }

  /// The controlword on the way to OperationEnabled (IEC 61800-7-201): 0x06, 0x07, 0x0F, each only
  /// once the statusword confirms the step before.
  std::uint16_t enabling_controlword() const;

  /// Units of target_velocity for a wheel speed, not yet rounded or limited.
  double target_units(double speed_radps) const;
  /// The largest magnitude of target_velocity that its object can carry, both signs.
  std::int64_t largest_target() const;

  // --- what is known
  const std::string& name() const { return name_; }
  std::uint8_t node() const { return config_.node; }
  const ObjectRef& controlword_object() const { return config_.controlword; }
  /// The state by the newest statusword; nullopt if there is none or it matches no state.
  std::optional<canopen::DriveState> state() const;
  /// Whether this is the state by a statusword received since the controlword last changed.
  std::optional<canopen::DriveState> confirmed_state() const;
  bool in_fault() const;
  /// Whether anything was received of it since begin().
  bool known() const { return status_stamp_ || speed_stamp_; }
  /// By both witnesses, as of the newest report, the wheel stood, however old that is.
  bool stood() const;
  /// By one of them it turned.
  bool turned() const;
  /// Power stage off, confirmed: SwitchOnDisabled or ReadyToSwitchOn.
  bool confirmed_off() const;
  /// The wheel stands, by a speed and a position received since the controlword last changed.
  bool confirmed_standing(Instant now) const;
  bool standing(Instant now) const { return motion(now) == Motion::standing; }
  bool turning(Instant now) const { return motion(now) == Motion::turning; }
  /// Verdict of both witnesses of the wheel, speed and position.
  Motion motion(Instant now) const { return motion_.judge(now); }
  /// The newest speed, if it is fresh; and the faster of both witnesses, if one is.
  std::optional<double> reported_radps(Instant now) const { return motion_.reported_radps(now); }
  std::optional<double> fastest_radps(Instant now) const { return motion_.fastest_radps(now); }
  /// Statusword, speed and position are all younger than the timeout.
  bool fresh(Instant now) const;
  /// The age of the oldest of these three; the longest duration if one has not come yet.
  Duration age(Instant now) const;
  std::optional<std::int64_t> mode() const { return mode_; }
  /// The drive's error code: 0x603F, else that of its newest emergency message; 0: none.
  std::uint32_t error_code() const { return error_code_ != 0 ? error_code_ : emergency_code_; }
  WheelFeedback feedback() const;

 private:
  void on_position(std::int64_t raw, Instant now);

  AxisConfig config_;
  std::string name_;
  Duration feedback_timeout_;
  double standstill_radps_;
  WheelMotion motion_;

  std::int64_t seen_raw_ = 0;     // newest raw value of motion_, anchored or not
  std::int64_t seen_counts_ = 0;  // the same, unwrapped

  std::optional<Instant> status_stamp_, speed_stamp_, position_stamp_;
  std::uint16_t statusword_ = 0;
  bool status_confirms_ = false;
  bool speed_confirms_ = false;
  bool position_confirms_ = false;
  double speed_radps_ = 0.0;
  bool anchored_ = false;
  std::int64_t raw_position_ = 0;
  std::int64_t position_counts_ = 0;   // unwrapped, forward positive
  std::optional<Instant> counted_at_;  // when raw_position_ came; outlasts begin()
  double counted_speed_radps_ = 0.0;   // speed at that time
  double uncounted_rad_ = 0.0;
  std::optional<std::int64_t> mode_;
  std::uint32_t error_code_ = 0;
  std::uint32_t emergency_code_ = 0;
  std::uint16_t controlword_ = canopen::kControlDisableVoltage;
};

}  // namespace tether::cia402
