#include "tools/can/twist_drive.hpp"

#include <fmt/format.h>

#include <cmath>

#include "common/base/text.hpp"

namespace tether {

std::string state_line(const drivetrain_state_t& state) {
  return fmt::format("{}{}{}", printable_message(state.state_name, kLongestNameShown),
                     state.reason.empty() ? "" : ": ", printable_message(state.reason));
}

TwistDrive::TwistDrive(const Twist& twist, Duration duration, Instant now)
    : twist_(twist), duration_(duration), since_(now), heard_(now), changed_(now) {}

void TwistDrive::on_state(const drivetrain_state_t& state, Instant now) {
  heard_ = now;
  if (!state_ || state_->v_mps != state.v_mps || state_->omega_radps != state.omega_radps) {
    changed_ = now;
  }
  state_ = state;
}

void TwistDrive::on_odometry(const odometry_t& odometry) {
  if (odometry_ && phase_ != Phase::waiting) {
    distance_m_ += odometry.distance_m - odometry_->distance_m;
    yaw_rad_ += wrap_angle(odometry.yaw_rad - odometry_->yaw_rad);
  }
  odometry_ = odometry;
}

void TwistDrive::on_foreign_command(Instant now) {
  give_up(
      "another sender commands this vehicle, too: end the controller or the other "
      "`tether can drive` first",
      now);
}

void TwistDrive::interrupt(Instant now) { give_up("interrupted", now); }

Twist TwistDrive::step(Instant now) {
  if (phase_ == Phase::waiting) wait(now);
  if (phase_ == Phase::driving) drive(now);
  if (phase_ == Phase::stopping) come_to_rest(now);
  return phase_ == Phase::driving ? twist_ : Twist{};
}

void TwistDrive::wait(Instant now) {
  if (now - heard_ >= kSilence) {
    give_up("CAN/STATE is silent: has the bridge ended?", now);
  } else if (armed() && odometry_ && now - since_ >= kFirstZeros) {
    changed_ = now;
    enter(Phase::driving, now);
  } else if (now - since_ >= kArmPatience) {
    give_up(fmt::format("the drivetrain was not armed within {:.0f} s; it is {}",
                        to_seconds(kArmPatience), state_ ? state_line(*state_) : "silent"),
            now);
  }
}

void TwistDrive::drive(Instant now) {
  if (now - heard_ >= kSilence) {
    give_up("CAN/STATE is silent: has the bridge ended?", now);
  } else if (!armed()) {
    give_up(fmt::format("the drivetrain has stopped; it is {}", state_line(*state_)), now);
  } else if (beyond_limits(now)) {
    give_up(fmt::format("the bridge makes {:.3f} m/s, {:.3f} rad/s of it: the twist is beyond "
                        "can.max_speed_mps, can.max_reverse_mps, can.max_yaw_rate_radps or the "
                        "wheels' speed in the bridge's scenario",
                        state_->v_mps, state_->omega_radps),
            now);
  } else if (now - since_ >= duration_) {
    enter(Phase::stopping, now);
  }
}

void TwistDrive::come_to_rest(Instant now) {
  if (failure_.empty() && !armed()) {
    failure_ = fmt::format("the drivetrain has stopped; it is {}", state_line(*state_));
  }
  if (now - since_ < kLastZeros) return;
  if (!failure_.empty() || stands()) return enter(Phase::done, now);
  if (now - since_ >= kStopPatience) {
    failure_ = fmt::format("the vehicle does not stand {:.0f} s after the last command but zero",
                           to_seconds(kStopPatience));
    enter(Phase::done, now);
  }
}

void TwistDrive::enter(Phase phase, Instant now) {
  phase_ = phase;
  since_ = now;
}

void TwistDrive::give_up(const std::string& why, Instant now) {
  if (!failure_.empty() || phase_ == Phase::done) return;
  failure_ = why;
  enter(Phase::stopping, now);
}

bool TwistDrive::stands() const {
  constexpr double kStill_mps = 0.005, kStill_radps = 0.01;
  return state_->v_mps == 0.0 && state_->omega_radps == 0.0 &&
         std::abs(odometry_->v_mps) < kStill_mps && std::abs(odometry_->omega_radps) < kStill_radps;
}

bool TwistDrive::beyond_limits(Instant now) const {
  constexpr double kTiny = 1e-6, kFresh_s = 0.15;
  const double age_s = state_->command_age_s;
  // Commands that do not arrive are not judged here: the bridge stops for them, and says why.
  if (now - changed_ < kSettled || age_s < 0.0 || age_s > kFresh_s) return false;
  return std::abs(state_->v_mps - twist_.v_mps) > kTiny ||
         std::abs(state_->omega_radps - twist_.omega_radps) > kTiny;
}

}  // namespace tether
