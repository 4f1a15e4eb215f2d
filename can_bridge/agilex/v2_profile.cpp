#include "can_bridge/agilex/v2_profile.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "common/base/errors.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {
namespace {

using agilex::Condition;
using agilex::Mode;

constexpr Duration kRepeat = std::chrono::milliseconds(100);
/// Enough to brake from 3 m/s at 1 m/s², which every chassis can.
constexpr int kBrakeLimit_ms = 3000;
/// Five periods of 0x211: by then, a change of mode shows.
constexpr int kSettle_ms = 100;
/// The most that the way can change between two frames, 20 ms apart: no chassis drives 50 m/s.
constexpr std::int64_t kLargestStep_mm = 1000;
/// From 3 m/s, wheels without power roll out within 10 s at 0.3 m/s².
constexpr double kRollOut_s = 10.0;

bool differs(double a, double b) { return std::abs(a - b) > 0.01 * std::abs(b); }

/// Forward difference of a counter that wraps.
std::int64_t difference(std::int32_t now, std::int32_t before) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(now) -
                                   static_cast<std::uint32_t>(before));
}

WheelMotion motion_of(const AgilexV2Config& config, double wheel_radius_m) {
  constexpr double kCount_m = 0.001;
  return {config.standstill_radps, kCount_m / wheel_radius_m,
          std::chrono::milliseconds(config.feedback_timeout_ms)};
}

const char* state_text(const agilex::SystemState& state) {
  if (state.condition == Condition::emergency_stop) return "EmergencyStop";
  if (state.condition == Condition::exception) return "Exception";
  switch (state.mode) {
    case Mode::standby:
      return "Standby";
    case Mode::can:
      return "CanControl";
    case Mode::remote:
    case Mode::remote_mini:
      return "RemoteControl";
  }
  return "unknown";
}

std::string condition_reason(const agilex::SystemState& state) {
  if (state.condition == Condition::emergency_stop) {
    return "chassis: emergency stop is pressed: release it, then reset";
  }
  return fmt::format(
      "chassis: reports an exception, error 0x{:04X} (bits: see the chassis' manual, frame 0x211), "
      "battery {:.1f} V",
      state.error_code, state.battery_V);
}

}  // namespace

std::unique_ptr<DriveProfile> make_profile(const AgilexV2Config& config,
                                           const VehicleConfig& vehicle) {
  return std::make_unique<AgilexV2Profile>(config, vehicle.wheel_radius_m, vehicle.track_m);
}

AgilexV2Profile::AgilexV2Profile(const AgilexV2Config& config, double wheel_radius_m,
                                 double track_m)
    : config_(config),
      wheel_radius_m_(wheel_radius_m),
      track_m_(track_m),
      wheels_motion_{motion_of(config, wheel_radius_m), motion_of(config, wheel_radius_m)} {
  assert(wheel_radius_m > 0.0 && track_m > 0.0);
  if (differs(wheel_radius_m, config.chassis_wheel_radius_m) ||
      differs(track_m, config.chassis_track_m)) {
    throw UsageError(fmt::format(
        "drivetrain \"{}\": its chassis has wheel_radius_m = {} and track_m = {}, the vehicle {} "
        "and {}: they must agree, because the chassis computes its wheel speeds itself",
        config.name, config.chassis_wheel_radius_m, config.chassis_track_m, wheel_radius_m,
        track_m));
  }
}

std::vector<CanFilter> AgilexV2Profile::filters() const {
  return {{agilex::kSystemState},   {agilex::kMotionState}, {agilex::kOdometry},
          {agilex::kMotionCommand}, {agilex::kModeCommand}, {agilex::kClearCommand}};
}

void AgilexV2Profile::enter(DrivePhase phase, std::string reason) {
  phase_ = phase;
  reason_ = std::move(reason);
  entered_.reset();
  repeated_.reset();
  command_ = {};
}

void AgilexV2Profile::start(Instant now) {
  enter(DrivePhase::starting, "waiting for the chassis");
  entered_ = now;
  clear_errors_ = false;
}

void AgilexV2Profile::enable() {
  if (phase_ == DrivePhase::standby) enter(DrivePhase::enabling, "changing into CAN mode");
}

void AgilexV2Profile::stop(StopKind kind) {
  if (phase_ == DrivePhase::stopping && kind == StopKind::disable) stop_kind_ = kind;
  if (phase_ != DrivePhase::enabled && phase_ != DrivePhase::enabling) return;
  stop_kind_ = kind;
  enter(DrivePhase::stopping);
}

void AgilexV2Profile::reset_fault() {
  intruder_.clear();
  if (phase_ != DrivePhase::faulted && phase_ != DrivePhase::refused) return;
  enter(DrivePhase::starting, "waiting for the chassis");
  clear_errors_ = true;
}

void AgilexV2Profile::set_command(const Twist& twist) {
  if (phase_ != DrivePhase::enabled) return;
  assert(is_usable(twist));
  constexpr double kLargest = 32767.0;
  const double v = twist.v_mps * 1000.0, omega = twist.omega_radps * 1000.0;
  const double scale = std::min(1.0, kLargest / std::max({std::abs(v), std::abs(omega), 1.0}));
  command_ = {static_cast<std::int16_t>(std::lround(v * scale)),
              static_cast<std::int16_t>(std::lround(omega * scale))};
}

// ---------------------------------------------------------------------------- receiving

void AgilexV2Profile::on_frame(const CanFrame& frame, Instant now) {
  if (frame.extended || frame.remote) return;
  switch (frame.id) {
    case agilex::kSystemState:
      if (const auto state = agilex::decode_system_state(frame)) {
        state_ = *state;
        state_stamp_ = now;
      } else {
        ++counters_.rejected_frames;
      }
      break;
    case agilex::kMotionState:
      if (const auto motion = agilex::decode_motion(frame)) {
        motion_ = *motion;
        motion_stamp_ = now;
        const std::array<double, 2> speeds_radps = wheel_speeds_radps();
        for (std::size_t i = 0; i < 2; ++i) wheels_motion_.at(i).on_speed(speeds_radps.at(i), now);
      } else {
        ++counters_.rejected_frames;
      }
      break;
    case agilex::kOdometry:
      if (const auto odometry = agilex::decode_odometry(frame)) {
        on_odometry(*odometry, now);
      } else {
        ++counters_.rejected_frames;
      }
      break;
    case agilex::kMotionCommand:
    case agilex::kModeCommand:
    case agilex::kClearCommand:
      on_intruder(frame.id);  // own frames never come back
      break;
    default:
      break;
  }
}

void AgilexV2Profile::on_intruder(std::uint32_t id) {
  ++counters_.intruder_frames;
  intruder_ = fmt::format("0x{:03X} from another sender", id);
  // The first reason stays, and a chassis that was refused is not commanded at all.
  if (phase_ == DrivePhase::faulted || phase_ == DrivePhase::refused) return;
  fault(fmt::format("another sender uses 0x{:03X}: only one master may command", id));
}

void AgilexV2Profile::on_odometry(const agilex::Odometry& odometry, Instant now) {
  const std::optional<Instant> before = odometry_stamp_;
  const std::array<std::int64_t, 2> step{difference(odometry.left_mm, odometry_.left_mm),
                                         difference(odometry.right_mm, odometry_.right_mm)};
  const bool close = heard_lately(odometry_stamp_, now);
  odometry_ = odometry;
  odometry_stamp_ = now;
  if (std::max(std::abs(step[0]), std::abs(step[1])) > kLargestStep_mm) {
    for (WheelMotion& motion : wheels_motion_) motion.forget_position();
  }
  wheels_motion_[0].on_position(odometry.left_mm / 1000.0 / wheel_radius_m_, now);
  wheels_motion_[1].on_position(odometry.right_mm / 1000.0 / wheel_radius_m_, now);
  const double speed_before_mps = counted_speed_mps_;
  const auto [left_radps, right_radps] = wheel_speeds_radps();
  counted_speed_mps_ = std::max(std::abs(left_radps), std::abs(right_radps)) * wheel_radius_m_;
  if (!before) return;
  const std::int64_t largest = std::max(std::abs(step[0]), std::abs(step[1]));
  const double possible_mm = kLargestStep_mm + 2e3 * speed_before_mps * to_seconds(now - *before);
  const bool may_have_restarted =
      !close && std::max(std::abs(std::int64_t{odometry.left_mm}),
                         std::abs(std::int64_t{odometry.right_mm})) < kLargestStep_mm;
  if (static_cast<double>(largest) <= possible_mm && !may_have_restarted) {
    way_mm_[0] += step[0];
    way_mm_[1] += step[1];
    return;
  }
  uncounted_m_ += (speed_before_mps + config_.standstill_radps * wheel_radius_m_) *
                  std::min(to_seconds(now - *before), kRollOut_s);
  // After a silence, which is a fault anyway, the way may have changed by any amount.
  const bool running = phase_ == DrivePhase::standby || phase_ == DrivePhase::enabling ||
                       phase_ == DrivePhase::enabled || phase_ == DrivePhase::stopping;
  if (close && running) {
    fault(fmt::format("chassis: its odometer jumped by {} mm left, {} mm right: it has restarted",
                      step[0], step[1]));
  }
}

// ---------------------------------------------------------------------------- sending

void AgilexV2Profile::tick(Instant now, std::vector<CanFrame>& out) {
  if (!entered_) entered_ = now;
  supervise(now);
  if (!entered_) entered_ = now;
  switch (phase_) {
    case DrivePhase::starting:
      tick_starting(now, out);
      break;
    case DrivePhase::enabling:
      tick_enabling(now, out);
      break;
    case DrivePhase::enabled:
      out.push_back(agilex::encode(agilex::kMotionCommand, command_));
      break;
    case DrivePhase::stopping:
      tick_stopping(now, out);
      break;
    case DrivePhase::faulted:
      bring_to_standby(now, true, out);
      break;
    case DrivePhase::standby:
    case DrivePhase::refused:
      break;
  }
}

void AgilexV2Profile::supervise(Instant now) {
  const bool running = phase_ == DrivePhase::standby || phase_ == DrivePhase::enabling ||
                       phase_ == DrivePhase::enabled || phase_ == DrivePhase::stopping;
  if (!running) return;
  if (const std::string frames = missing(now); !frames.empty()) {
    fault(fmt::format("chassis: no {} for {} ms: check its supply and the CAN plug", frames,
                      config_.feedback_timeout_ms));
  } else if (state_.condition != Condition::normal) {
    fault(condition_reason(state_));
  } else if (phase_ == DrivePhase::enabled && state_.mode != Mode::can) {
    fault(fmt::format("chassis: left CAN mode by itself, is now in {}: remote control took over?",
                      state_text(state_)));
  } else if (phase_ == DrivePhase::standby && state_.mode == Mode::can) {
    fault("chassis: is in CAN mode without having been armed: another program on this bus?");
  }
}

void AgilexV2Profile::tick_starting(Instant now, std::vector<CanFrame>& out) {
  if (const std::string frames = missing(now); !frames.empty()) {
    if (lasts(now, config_.boot_timeout_ms)) {
      enter(DrivePhase::refused,
            fmt::format("chassis: no {}: check its supply, the CAN plug, termination and the bit "
                        "rate (500 kbit/s)",
                        frames));
    }
    return;
  }
  if (state_.condition != Condition::normal) {
    if (!clear_errors_ || lasts(now, config_.step_timeout_ms)) {
      fault(condition_reason(state_));
    } else {
      repeat(now, agilex::clear_frame(), out);
    }
    return;
  }
  if (bring_to_standby(now, true, out)) {
    enter(DrivePhase::standby);
  } else if (lasts(now, kBrakeLimit_ms + config_.step_timeout_ms)) {
    fault("chassis: does not leave CAN mode: another program on this bus?");
  }
}

void AgilexV2Profile::tick_enabling(Instant now, std::vector<CanFrame>& out) {
  if (state_.mode == Mode::can) {
    enter(DrivePhase::enabled);
    out.push_back(agilex::encode(agilex::kMotionCommand, command_));
    return;
  }
  if (lasts(now, config_.step_timeout_ms)) {
    fault(
        fmt::format("chassis: stays in {} for {} ms, does not change into CAN mode: set the "
                    "transmitter's switch to command mode",
                    state_text(state_), config_.step_timeout_ms));
    return;
  }
  out.push_back(agilex::encode(agilex::kMotionCommand, agilex::Motion{}));
  repeat(now, agilex::mode_frame(Mode::can), out);
}

void AgilexV2Profile::tick_stopping(Instant now, std::vector<CanFrame>& out) {
  if (bring_to_standby(now, stop_kind_ == StopKind::quick, out)) {
    // A change into CAN mode may still be under way: command standby mode, and look again.
    repeat(now, agilex::mode_frame(Mode::standby), out);
    if (lasts(now, kSettle_ms)) enter(DrivePhase::standby);
  } else if (lasts(now, kBrakeLimit_ms + config_.step_timeout_ms)) {
    fault(turning(now)
              ? "chassis: its wheels still turn after a stop: use the hard-wired emergency "
                "stop"
              : "chassis: does not leave CAN mode");
  }
}

bool AgilexV2Profile::bring_to_standby(Instant now, bool brake_first, std::vector<CanFrame>& out) {
  // A chassis in remote control is driven by its remote control.
  if (state_stamp_ && state_.mode != Mode::can) return true;
  out.push_back(agilex::encode(agilex::kMotionCommand, agilex::Motion{}));
  const bool stands = standstill(now) && now >= standstill_from_;
  const bool may_cut = (!brake_first || lasts(now, kBrakeLimit_ms)) && !turning(now);
  if (stands || may_cut) {
    repeat(now, agilex::mode_frame(Mode::standby), out);
  }
  return false;
}

void AgilexV2Profile::repeat(Instant now, const CanFrame& frame, std::vector<CanFrame>& out) {
  if (repeated_ && now - *repeated_ < kRepeat) return;
  repeated_ = now;
  out.push_back(frame);
}

// ---------------------------------------------------------------------------- asking

bool AgilexV2Profile::lasts(Instant now, int milliseconds) const {
  return entered_ && now - *entered_ >= std::chrono::milliseconds(milliseconds);
}

bool AgilexV2Profile::heard_lately(const std::optional<Instant>& stamp, Instant now) const {
  return stamp && now - *stamp < std::chrono::milliseconds(config_.feedback_timeout_ms);
}

std::string AgilexV2Profile::missing(Instant now) const {
  std::string text;
  const auto name = [&](const std::optional<Instant>& stamp, const char* frame) {
    if (!heard_lately(stamp, now)) text += (text.empty() ? "" : ", ") + std::string(frame);
  };
  name(state_stamp_, "0x211");
  name(motion_stamp_, "0x221");
  name(odometry_stamp_, "0x311");
  return text;
}

bool AgilexV2Profile::feedback_fresh(Instant now) const {
  return heard_lately(motion_stamp_, now) && heard_lately(odometry_stamp_, now);
}

std::array<double, 2> AgilexV2Profile::wheel_speeds_radps() const {
  const WheelSpeeds rims =
      to_wheel_speeds({motion_.v_mmps / 1000.0, motion_.omega_mradps / 1000.0}, track_m_);
  return {rims.left_mps / wheel_radius_m_, rims.right_mps / wheel_radius_m_};
}

bool AgilexV2Profile::standstill(Instant now) const {
  return feedback_fresh(now) &&
         std::ranges::all_of(wheels_motion_, [now](const WheelMotion& wheel) {
           return wheel.judge(now) == Motion::standing;
         });
}

bool AgilexV2Profile::turning(Instant now) const {
  return std::ranges::any_of(wheels_motion_, [now](const WheelMotion& wheel) {
    return wheel.judge(now) == Motion::turning;
  });
}

DrivetrainSnapshot AgilexV2Profile::snapshot(Instant now) const {
  DrivetrainSnapshot s;
  s.phase = phase_;
  s.reason = reason_;
  s.feedback_fresh = feedback_fresh(now);
  s.standstill = standstill(now);
  const std::array<double, 2> speeds = wheel_speeds_radps();
  s.turning = turning(now);
  const bool heard = motion_stamp_ || odometry_stamp_;
  const bool stood = std::ranges::all_of(
      wheels_motion_, [](const WheelMotion& wheel) { return wheel.newest() == Motion::standing; });
  s.in_doubt = state_.mode == Mode::can || (heard && !stood);
  for (std::size_t i = 0; i < 2; ++i) {
    WheelFeedback& wheel = s.wheels.at(i);
    wheel.valid = motion_stamp_ && odometry_stamp_;
    if (wheel.valid) wheel.stamp = std::max(*motion_stamp_, *odometry_stamp_);
    wheel.position_counts = way_mm_.at(i);
    wheel.angle_rad = static_cast<double>(way_mm_.at(i)) / 1000.0 / wheel_radius_m_;
    wheel.uncounted_rad = uncounted_m_ / wheel_radius_m_;
    wheel.speed_radps = speeds.at(i);
    wheel.fastest_radps = wheels_motion_.at(i).fastest_radps(now).value_or(speeds.at(i));
    wheel.state = state_stamp_ ? state_text(state_) : "";
    wheel.statusword =
        static_cast<std::uint32_t>(state_.condition) << 8 | static_cast<std::uint32_t>(state_.mode);
    wheel.error_code = state_.error_code;
  }
  return s;
}

}  // namespace tether
