#include "can_bridge/agilex/emulated_v2.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tether {
namespace {

using agilex::Condition;
using agilex::Mode;

constexpr Duration kBoot = std::chrono::milliseconds(500);
constexpr Duration kPeriod = std::chrono::milliseconds(agilex::kPeriod_ms);
constexpr Duration kCommandTimeout = std::chrono::milliseconds(agilex::kCommandTimeout_ms);
constexpr double kAcceleration_mps2 = 2.0;
constexpr double kYawAcceleration_radps2 = 4.0;
constexpr double kBattery_V = 24.0;

double approach(double value, double target, double largest_step) {
  return value + std::clamp(target - value, -largest_step, largest_step);
}

std::int16_t saturated(double value) {
  return static_cast<std::int16_t>(std::lround(std::clamp(value, -32768.0, 32767.0)));
}

}  // namespace

EmulatedAgilexV2::EmulatedAgilexV2(const AgilexV2Config& config, Instant now)
    : wheel_radius_m_(config.chassis_wheel_radius_m), track_m_(config.chassis_track_m) {
  power_on(now);
}

std::vector<CanFilter> EmulatedAgilexV2::filters() const {
  return {{agilex::kMotionCommand}, {agilex::kModeCommand}, {agilex::kClearCommand}};
}

void EmulatedAgilexV2::power_on(Instant now) {
  state_ = {};
  state_.battery_V = kBattery_V;
  command_ = {};
  setpoint_ = {};
  commanded_at_ = ramped_at_ = silent_until_ = now;
  boots_until_ = next_report_ = now + kBoot;
  for (EmulatedEncoder& encoder : encoders_) {
    encoder.restart();
    encoder.set_frozen(false);
    encoder.set_slip(0.0);
  }
}

void EmulatedAgilexV2::on_frame(const CanFrame& frame, Instant now,
                                std::vector<CanFrame>& /*out*/) {
  if (!running(now) || frame.extended || frame.remote) return;
  if (frame.id == agilex::kMotionCommand) {
    if (const auto motion = agilex::decode_motion(frame)) {
      command_ = *motion;
      commanded_at_ = now;
    }
  } else if (frame.id == agilex::kModeCommand && frame.size >= 1) {
    const bool can = frame.data[0] == static_cast<std::uint8_t>(Mode::can);
    const bool standby = frame.data[0] == static_cast<std::uint8_t>(Mode::standby);
    if (can && state_.condition == Condition::normal && state_.mode != Mode::can) {
      state_.mode = Mode::can;
      command_ = {};  // commands before the change do not count
    } else if (standby) {
      state_.mode = Mode::standby;
    }
  } else if (frame.id == agilex::kClearCommand && frame.size >= 1 && frame.data[0] == 0) {
    state_.condition = Condition::normal;
    state_.error_code = 0;
  }
}

void EmulatedAgilexV2::tick(Instant now, std::vector<CanFrame>& out) {
  ramp(now);
  if (now < next_report_) return;
  next_report_ += kPeriod;
  // After a pause of the caller, missed frames are not sent in a burst.
  if (next_report_ <= now) next_report_ = now + kPeriod;
  ++state_.count;
  if (now >= silent_until_) report(out);
}

void EmulatedAgilexV2::ramp(Instant now) {
  const double dt_s = to_seconds(now - ramped_at_);
  ramped_at_ = now;
  const bool follows = running(now) && state_.condition == Condition::normal &&
                       state_.mode == Mode::can && now - commanded_at_ < kCommandTimeout;
  const Twist target =
      follows ? Twist{command_.v_mmps / 1000.0, command_.omega_mradps / 1000.0} : Twist{};
  setpoint_.v_mps = approach(setpoint_.v_mps, target.v_mps, kAcceleration_mps2 * dt_s);
  setpoint_.omega_radps =
      approach(setpoint_.omega_radps, target.omega_radps, kYawAcceleration_radps2 * dt_s);
}

void EmulatedAgilexV2::report(std::vector<CanFrame>& out) {
  const double left_mps = encoders_[0].speed_radps() * wheel_radius_m_;
  const double right_mps = encoders_[1].speed_radps() * wheel_radius_m_;
  const Twist seen = to_twist({left_mps, right_mps}, track_m_);
  out.push_back(agilex::encode(state_));
  out.push_back(agilex::encode(
      agilex::kMotionState,
      agilex::Motion{saturated(seen.v_mps * 1000.0), saturated(seen.omega_radps * 1000.0)}));
  const std::array<std::uint32_t, 2> ids{agilex::kMotor1State, agilex::kMotor2State};
  for (std::size_t i = 0; i < 2; ++i) {
    agilex::MotorState motor;
    motor.speed_rpm = saturated(encoders_.at(i).speed_radps() * 30.0 / std::numbers::pi);
    out.push_back(agilex::encode(ids.at(i), motor));
  }
  const double mm_per_rad = wheel_radius_m_ * 1000.0;
  // Conversion to 32 bits wraps, as in the chassis.
  out.push_back(
      agilex::encode(agilex::Odometry{static_cast<std::int32_t>(encoders_[0].counts(mm_per_rad)),
                                      static_cast<std::int32_t>(encoders_[1].counts(mm_per_rad))}));
}

void EmulatedAgilexV2::set_wheels(const WheelStates& wheels) {
  for (std::size_t i = 0; i < 2; ++i) {
    encoders_.at(i).turn(wheels.angle_rad.at(i), wheels.speed_radps.at(i));
  }
}

std::array<double, 2> EmulatedAgilexV2::wheel_targets_radps() const {
  const WheelSpeeds rims = to_wheel_speeds(setpoint_, track_m_);
  return {rims.left_mps / wheel_radius_m_, rims.right_mps / wheel_radius_m_};
}

void EmulatedAgilexV2::inject(const DriveFault& fault, Instant now) {
  switch (fault.kind) {
    case DriveFault::Kind::none:
      silent_until_ = now;
      for (EmulatedEncoder& encoder : encoders_) {
        encoder.set_frozen(false);
        encoder.set_slip(0.0);
      }
      break;
    case DriveFault::Kind::fault:
      state_.condition = Condition::exception;
      state_.mode = Mode::standby;
      state_.error_code =
          fault.value >= 1.0 ? static_cast<std::uint16_t>(std::min(fault.value, 65535.0)) : 1;
      break;
    case DriveFault::Kind::reboot:
      power_on(now);
      break;
    case DriveFault::Kind::silence:
      silent_until_ =
          fault.value > 0.0 && fault.value < 1e6 ? now + from_seconds(fault.value) : Instant::max();
      break;
    case DriveFault::Kind::encoder_freeze:
      for (EmulatedEncoder& encoder : encoders_) encoder.set_frozen(true);
      break;
    case DriveFault::Kind::wheel_slip:
      for (EmulatedEncoder& encoder : encoders_)
        encoder.set_slip(std::clamp(fault.value, 0.0, 1.0));
      break;
    case DriveFault::Kind::sdo_abort:
    case DriveFault::Kind::push:
    case DriveFault::Kind::weak_brake:
      break;
  }
}

std::unique_ptr<EmulatedDrivetrain> emulate(const AgilexV2Config& config, Instant now) {
  return std::make_unique<EmulatedAgilexV2>(config, now);
}

}  // namespace tether
