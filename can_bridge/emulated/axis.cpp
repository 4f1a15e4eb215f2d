#include "can_bridge/emulated/axis.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

void EmulatedAxis::power_up() {
  const double coasting = brake_ ? 0.0 : setpoint_;
  *this = EmulatedAxis(brake_);
  setpoint_ = coasting;
}

void EmulatedAxis::write_control(std::uint16_t word) {
  const std::uint16_t risen = word & static_cast<std::uint16_t>(~control_);
  if ((risen & canopen::kControlFaultReset) != 0) reset_edge_ = true;
  control_ = word;
  written_ = true;
}

void EmulatedAxis::enter(State state) {
  state_ = state;
  written_ = false;
  reset_edge_ = false;
  if (!powered() && brake_) setpoint_ = 0.0;
}

void EmulatedAxis::trip(std::uint16_t error_code) {
  if (state_ == State::fault || state_ == State::fault_reaction) return;
  braking_ = powered();
  error_code_ = error_code;
  enter(State::fault_reaction);
}

void EmulatedAxis::quick_stop() {
  if (state_ == State::operation_enabled) {
    enter(State::quick_stop_active);
  } else if (state_ == State::ready_to_switch_on || state_ == State::switched_on) {
    enter(State::switch_on_disabled);
  }
}

void EmulatedAxis::disable_voltage() {
  switch (state_) {
    case State::ready_to_switch_on:
    case State::switched_on:
    case State::operation_enabled:
    case State::quick_stop_active:
      enter(State::switch_on_disabled);
      break;
    default:
      break;
  }
}

void EmulatedAxis::tick(const Settings& settings, Duration dt) {
  if (state_ == State::not_ready) {
    self_test_left_ -= dt;
    if (self_test_left_ <= Duration{0}) enter(State::switch_on_disabled);
    move(settings, to_seconds(dt));
    judge(settings);
    return;
  }
  follow_control(settings);
  move(settings, to_seconds(dt));
  judge(settings);
}

void EmulatedAxis::follow_control(const Settings& s) {
  switch (state_) {
    case State::switch_on_disabled:
      if (commands_shutdown()) enter(State::ready_to_switch_on);
      break;
    case State::ready_to_switch_on:
      if (commands_disable_voltage() || commands_quick_stop()) {
        enter(State::switch_on_disabled);
      } else if (commands_switch_on()) {
        enter(State::switched_on);
      }
      break;
    case State::switched_on:
      if (commands_disable_voltage() || commands_quick_stop()) {
        enter(State::switch_on_disabled);
      } else if (commands_shutdown()) {
        enter(State::ready_to_switch_on);
      } else if (commands_enable() && s.mode == kProfileVelocity) {
        enter(State::operation_enabled);
        setpoint_ = s.actual;  // the ramps start from the wheel's own speed
      }
      break;
    case State::operation_enabled:
      follow_control_enabled(s);
      break;
    case State::quick_stop_active:
      finish_quick_stop(s);
      break;
    case State::fault_reaction:
      finish_fault_reaction(s);
      break;
    case State::fault:
      if (reset_edge_) {
        error_code_ = 0;
        enter(State::switch_on_disabled);
      }
      break;
    case State::not_ready:
      break;
  }
}

void EmulatedAxis::follow_control_enabled(const Settings& s) {
  if (commands_disable_voltage()) {
    enter(State::switch_on_disabled);
  } else if (commands_quick_stop()) {
    enter(State::quick_stop_active);
    finish_quick_stop(s);  // option 0 has no ramp
  } else if (commands_shutdown()) {
    enter(State::ready_to_switch_on);
  } else if (!commands_enable() && commands_switch_on() && setpoint_ == 0.0) {
    enter(State::switched_on);  // "disable operation" ramps down first (0x605C = 1, its default)
  }
}

void EmulatedAxis::finish_quick_stop(const Settings& s) {
  const bool stays = s.quick_stop_option >= 5;
  const bool stopped = setpoint_ == 0.0 || s.quick_stop_option == 0;
  if (commands_disable_voltage() || (stopped && !stays)) {
    enter(State::switch_on_disabled);
  } else if (stays && written_ && commands_enable()) {
    enter(State::operation_enabled);
  }
}

void EmulatedAxis::finish_fault_reaction(const Settings& s) {
  if (braking_ && setpoint_ != 0.0 && s.fault_reaction_option != 0) return;
  braking_ = false;
  enter(State::fault);
}

void EmulatedAxis::coast(double friction, double push, Duration dt) {
  if (brake_) return;
  setpoint_ += push * to_seconds(dt);
  ramp_to(0.0, friction, friction, to_seconds(dt));
}

void EmulatedAxis::move(const Settings& s, double dt_s) {
  if (!powered()) return coast(s.friction, s.push, from_seconds(dt_s));
  const double deceleration = s.brake_share * s.deceleration;
  if (state_ == State::operation_enabled) {
    const bool stopping = halted() || !commands_enable();
    const double target = stopping ? 0.0 : std::clamp(s.target, -s.max_speed, s.max_speed);
    ramp_to(target, s.acceleration, deceleration, dt_s);
    return;
  }
  const int option =
      state_ == State::quick_stop_active ? s.quick_stop_option : s.fault_reaction_option;
  const bool on_quick_ramp = option == 2 || option == 6;
  const double quick_deceleration = s.brake_share * s.quick_stop_deceleration;
  ramp_to(0.0, s.acceleration, on_quick_ramp ? quick_deceleration : deceleration, dt_s);
}

void EmulatedAxis::ramp_to(double target, double acceleration, double deceleration, double dt_s) {
  double left_s = dt_s;
  const bool slowing = setpoint_ * target < 0.0 || std::abs(target) < std::abs(setpoint_);
  if (slowing) {
    // First to zero, if the target lies beyond zero.
    const double goal = setpoint_ * target < 0.0 ? 0.0 : target;
    const double needed_s = std::abs(setpoint_ - goal) / deceleration;
    if (needed_s > left_s) {
      setpoint_ -= std::copysign(deceleration * left_s, setpoint_);
      return;
    }
    setpoint_ = goal;
    left_s -= needed_s;
  }
  const double step = acceleration * left_s;
  setpoint_ += std::clamp(target - setpoint_, -step, step);
}

void EmulatedAxis::judge(const Settings& s) {
  speed_zero_ = std::abs(s.actual) <= s.window;
  internal_limit_ = state_ == State::operation_enabled && std::abs(s.target) > s.max_speed;
  const bool enabled = state_ == State::operation_enabled;
  if (state_ == State::quick_stop_active || (enabled && halted())) {
    target_reached_ = setpoint_ == 0.0 && speed_zero_;
  } else {
    const double target = std::clamp(s.target, -s.max_speed, s.max_speed);
    target_reached_ = enabled && std::abs(s.actual - target) <= s.window;
  }
}

std::uint16_t EmulatedAxis::statusword() const {
  constexpr unsigned kVoltage = 1u << 4;
  constexpr unsigned kWarning = 1u << 7;
  constexpr unsigned kRemote = 1u << 9;
  constexpr unsigned kTargetReached = 1u << 10;
  constexpr unsigned kInternalLimit = 1u << 11;
  constexpr unsigned kSpeedZero = 1u << 12;

  unsigned word = 0;
  switch (state_) {
    case State::not_ready:
      return 0;
    case State::switch_on_disabled:
      word = 0x40;
      break;
    case State::ready_to_switch_on:
      word = 0x21;
      break;
    case State::switched_on:
      word = 0x23;
      break;
    case State::operation_enabled:
      word = 0x27;
      break;
    case State::quick_stop_active:
      word = 0x07;
      break;
    case State::fault_reaction:
      word = 0x0F;
      break;
    case State::fault:
      word = 0x08;
      break;
  }
  word |= kVoltage | kRemote;
  if (warning_) word |= kWarning;
  if (target_reached_) word |= kTargetReached;
  if (internal_limit_) word |= kInternalLimit;
  if (speed_zero_) word |= kSpeedZero;
  return static_cast<std::uint16_t>(word);
}

void EmulatedDriveAxis::run(const ObjectDictionary& dictionary, Duration dt) {
  using Handle = ObjectDictionary::Handle;
  const auto real = [&](Handle h) { return static_cast<double>(dictionary.value(h)); };
  const auto option = [&](Handle h, int otherwise) {
    return h == ObjectDictionary::kNone ? otherwise : static_cast<int>(dictionary.value(h));
  };
  EmulatedAxis::Settings s;
  s.mode = static_cast<int>(dictionary.value(objects.mode));
  s.target = real(objects.target_velocity);
  s.acceleration = real(objects.acceleration);
  s.deceleration = real(objects.deceleration);
  s.quick_stop_deceleration = real(objects.quick_stop_deceleration);
  s.max_speed = real(objects.max_speed);
  // Wheels slower than this stand: a tenth of a radian a second, but at least half the drive's
  // unit.
  s.window = std::max(0.1 * objects.target_per_radps, 0.5);
  s.quick_stop_option = option(objects.quick_stop_option, 2);
  s.fault_reaction_option = option(objects.fault_option, 2);
  s.friction = coasting_radps2 * objects.target_per_radps;
  s.push = push_radps2 * objects.target_per_radps * objects.sign;
  s.brake_share = brake_share;
  s.actual = actual(objects.target_per_radps);
  machine.tick(s, dt);
}

void EmulatedDriveAxis::coast(Duration dt) {
  machine.coast(coasting_radps2 * objects.target_per_radps,
                push_radps2 * objects.target_per_radps * objects.sign, dt);
}

void EmulatedDriveAxis::show(ObjectDictionary& dictionary, std::uint16_t device_error) const {
  const auto put_half = [&dictionary](ObjectDictionary::Handle h, int shift, std::uint16_t word) {
    const std::int64_t others = dictionary.value(h) & ~(std::int64_t{0xFFFF} << shift);
    dictionary.store(h, others | static_cast<std::int64_t>(word) << shift);
  };
  const std::uint16_t error = machine.error_code() != 0 ? machine.error_code() : device_error;
  put_half(objects.statusword, objects.statusword_shift, machine.statusword());
  put_half(objects.error_code, objects.error_code_shift, error);
  dictionary.store(objects.mode_display, dictionary.value(objects.mode));
  dictionary.store(objects.actual_velocity, std::llround(actual(objects.actual_per_radps)));
  dictionary.store(objects.actual_position, objects.sign * encoder.counts(objects.counts_per_rad));
}

}  // namespace tether
