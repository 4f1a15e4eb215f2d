#include "tests/autonomy/campaign/driving_rules.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tether::test {

DrivingRules::DrivingRules(const AutonomySettings& autonomy, const Outline& outline, double step_s)
    : autonomy_(autonomy), stopping_(autonomy), outline_(outline), step_s_(step_s) {}

void DrivingRules::broken(const std::string& what) {
  if (broken_.empty()) broken_ = what;
}

void DrivingRules::check(Instant now, const OnboardDriver::Output& out, Instant last_fit) {
  if (out.state == DriveState::protective_stop && state_ != out.state) {
    stop_way_m_ = 0.0;
    may_go_m_ = stopping_.length_m(pace_mps(before_, outline_)) - stopping_.margin_m + 0.02;
  }
  state_ = out.state;
  check_change(out.setpoint);
  if (out.driver == Driver::none) check_driverless(out.setpoint);
  check_driver(now, out, last_fit);
  before_ = out.setpoint;
}

void DrivingRules::check_change(const Twist& u) {
  if (std::abs(u.v_mps - before_.v_mps) > autonomy_.deceleration_mps2 * step_s_ + 1e-9 ||
      std::abs(u.omega_radps - before_.omega_radps) >
          autonomy_.yaw_acceleration_radps2 * step_s_ + 1e-9) {
    broken("the setpoint jumps");
  }
}

void DrivingRules::check_driverless(const Twist& u) {
  const double is = pace_mps(u, outline_), was = pace_mps(before_, outline_);
  if (is <= 0.0 || is <= was - autonomy_.deceleration_mps2 * step_s_ + 1e-9) return;
  // Where turning takes longer than the way, both fall at the turn's rate.
  const double slowest = autonomy_.yaw_acceleration_radps2 * step_s_;
  if (std::abs(before_.omega_radps) - std::abs(u.omega_radps) < slowest - 1e-9) {
    broken("moves on without a driver");
  }
}

void DrivingRules::check_driver(Instant now, const OnboardDriver::Output& out, Instant last_fit) {
  const double is = pace_mps(out.setpoint, outline_), was = pace_mps(before_, outline_);
  if (is == 0.0) last_driver_ = Driver::none;
  if (is == 0.0 || out.driver == Driver::none) return;
  if (last_driver_ != Driver::none && last_driver_ != out.driver) {
    broken("no rest between drivers");
  }
  last_driver_ = out.driver;
  if (out.driver == Driver::law) {
    if (out.state != DriveState::autonomous) broken("the law drives, but not in AUTONOMOUS");
    if (now < kStart) broken("moves before t = 0");
    return;
  }
  if (out.state != DriveState::remote) broken("driven remotely, but not in REMOTE");
  if (now - last_fit >= from_seconds(autonomy_.remote_timeout_s)) {
    broken("no command that fits for too long");
  }
  if (is > std::max(autonomy_.remote_speed_mps, was) + 1e-9) broken("too fast for remote driving");
}

void DrivingRules::moved(double way_m) {
  stop_way_m_ += way_m;
  if (state_ == DriveState::protective_stop && stop_way_m_ > may_go_m_) {
    broken(
        fmt::format("{:.2f} m after a protective stop, {:.2f} m at most", stop_way_m_, may_go_m_));
  }
}

}  // namespace tether::test
