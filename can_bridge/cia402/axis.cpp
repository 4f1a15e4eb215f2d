#include "can_bridge/cia402/axis.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tether::cia402 {
namespace {

using canopen::DriveState;

constexpr double kTurn_rad = 2.0 * std::numbers::pi;
// No vehicle's wheel turns faster than this.
constexpr double kFastestWheel_rps = 50.0;
// From 3 m/s, wheels without power roll out within 10 s at 0.3 m/s²; most have brakes.
constexpr double kRollOut_s = 10.0;

/// a − b of a counter of `bytes` bytes that may have wrapped around in between.
std::int64_t wrapped_difference(std::int64_t a, std::int64_t b, std::uint8_t bytes) {
  const std::uint64_t range = std::uint64_t{1} << (8 * bytes);
  const std::uint64_t difference =
      (static_cast<std::uint64_t>(a) - static_cast<std::uint64_t>(b)) & (range - 1);
  return difference >= range / 2
             ? static_cast<std::int64_t>(difference) - static_cast<std::int64_t>(range)
             : static_cast<std::int64_t>(difference);
}

}  // namespace

Axis::Axis(const AxisConfig& config, std::string name, Duration feedback_timeout,
           double standstill_radps)
    : config_(config),
      name_(std::move(name)),
      feedback_timeout_(feedback_timeout),
      standstill_radps_(standstill_radps),
      motion_(standstill_radps, kTurn_rad / config.counts_per_revolution.value(),
              feedback_timeout) {}

void Axis::begin() {
  status_stamp_.reset();
  speed_stamp_.reset();
  position_stamp_.reset();
  statusword_ = 0;
  status_confirms_ = speed_confirms_ = position_confirms_ = false;
  speed_radps_ = 0.0;
  motion_.forget();
  mode_.reset();
  error_code_ = emergency_code_ = 0;
  controlword_ = canopen::kControlDisableVoltage;
  reanchor();
}

void Axis::receive(const PdoMap::Field& field, std::int64_t value, Instant now) {
  switch (field.signal) {
    case Signal::statusword:
      statusword_ = static_cast<std::uint16_t>(value >> config_.statusword_shift & 0xFFFF);
      status_stamp_ = now;
      status_confirms_ = true;
      break;
    case Signal::actual_velocity:
      speed_radps_ = static_cast<double>(config_.sign * value) * kTurn_rad /
                     config_.actual_velocity_per_rps.value();
      speed_stamp_ = now;
      speed_confirms_ = true;
      motion_.on_speed(speed_radps_, now);
      break;
    case Signal::actual_position:
      on_position(value, now);
      break;
    case Signal::mode_display:
      mode_ = value;
      break;
    case Signal::error_code:
      error_code_ = static_cast<std::uint32_t>(value);
      break;
    case Signal::controlword:
    case Signal::target_velocity:
    case Signal::mode:
      break;
  }
}

void Axis::on_position(std::int64_t raw, Instant now) {
  const std::int64_t travelled =
      wrapped_difference(raw, raw_position_, config_.actual_position.bytes);
  if (counted_at_) {
    const double silence_s = to_seconds(now - *counted_at_);
    const double speed_radps = std::max(std::abs(counted_speed_radps_), std::abs(speed_radps_));
    const double travelled_rad = static_cast<double>(std::abs(travelled)) * kTurn_rad /
                                 config_.counts_per_revolution.value();
    // A drive that resets its counter without a boot-up message jumps by more than the wheel can
    // have turned: one revolution more than twice what its speed says.
    const bool possible = travelled_rad <= kTurn_rad + 2.0 * speed_radps * silence_s;
    if (anchored_ && possible) {
      position_counts_ += config_.sign * travelled;
    } else {
      motion_.forget_position();
      uncounted_rad_ += (speed_radps + standstill_radps_) * std::min(silence_s, kRollOut_s);
      // Or the vehicle was pushed.
      if (anchored_) {
        uncounted_rad_ += std::min(travelled_rad, kFastestWheel_rps * kTurn_rad * silence_s);
      }
    }
  }
  raw_position_ = raw;
  anchored_ = true;
  position_stamp_ = counted_at_ = now;
  see_position(raw, now);
  counted_speed_radps_ = speed_radps_;
}

void Axis::see_position(std::int64_t raw, Instant now) {
  seen_counts_ += wrapped_difference(raw, seen_raw_, config_.actual_position.bytes);
  seen_raw_ = raw;
  position_confirms_ = true;
  const double count_rad = kTurn_rad / config_.counts_per_revolution.value();
  motion_.on_position(static_cast<double>(config_.sign * seen_counts_) * count_rad, now);
}

void Axis::take_up(std::int64_t raw, Instant now) {
  if (!anchored_ || !counted_at_) return;
  on_position(raw, now);
  counted_speed_radps_ = 0.0;
}

void Axis::command(std::uint16_t controlword) {
  if (controlword == controlword_) return;
  controlword_ = controlword;
  doubt();
}

std::uint16_t Axis::enabling_controlword() const {
  const std::optional<DriveState> state = confirmed_state();
  if (!state) return controlword_;
  switch (*state) {
    case DriveState::switch_on_disabled:
      return canopen::kControlShutdown;
    case DriveState::ready_to_switch_on:
      return canopen::kControlSwitchOn;
    case DriveState::switched_on:
    case DriveState::operation_enabled:
      return canopen::kControlEnableOperation;
    case DriveState::not_ready:
    case DriveState::quick_stop_active:
    case DriveState::fault_reaction:
    case DriveState::fault:
      break;
  }
  return canopen::kControlDisableVoltage;
}

double Axis::target_units(double speed_radps) const {
  return config_.sign * speed_radps / kTurn_rad * config_.target_velocity_per_rps.value();
}

std::int64_t Axis::largest_target() const {
  return (std::int64_t{1} << (8 * config_.target_velocity.bytes - 1)) - 1;
}

std::optional<DriveState> Axis::state() const {
  return status_stamp_ ? canopen::drive_state(statusword_) : std::nullopt;
}

std::optional<DriveState> Axis::confirmed_state() const {
  return status_confirms_ ? state() : std::nullopt;
}

bool Axis::in_fault() const {
  return state() == DriveState::fault || state() == DriveState::fault_reaction;
}

bool Axis::confirmed_off() const {
  return confirmed_state() == DriveState::switch_on_disabled ||
         confirmed_state() == DriveState::ready_to_switch_on;
}

bool Axis::stood() const { return motion_.newest() == Motion::standing; }

bool Axis::turned() const { return motion_.newest() == Motion::turning; }

bool Axis::confirmed_standing(Instant now) const {
  return speed_confirms_ && position_confirms_ && standing(now);
}

bool Axis::fresh(Instant now) const { return age(now) < feedback_timeout_; }

Duration Axis::age(Instant now) const {
  if (!status_stamp_ || !speed_stamp_ || !position_stamp_) return Duration::max();
  return now - std::min({*status_stamp_, *speed_stamp_, *position_stamp_});
}

WheelFeedback Axis::feedback() const {
  WheelFeedback result;
  result.valid = speed_stamp_ || position_stamp_;
  result.stamp =
      std::max(speed_stamp_.value_or(Instant::min()), position_stamp_.value_or(Instant::min()));
  if (!result.valid) result.stamp = Instant{};
  result.position_counts = position_counts_;
  result.angle_rad =
      static_cast<double>(position_counts_) * kTurn_rad / config_.counts_per_revolution.value();
  result.uncounted_rad = uncounted_rad_;
  result.speed_radps = speed_radps_;
  result.state = canopen::to_string(state());
  result.statusword = statusword_;
  result.error_code = error_code();
  return result;
}

}  // namespace tether::cia402
