#include "tests/autonomy/campaign/fault.hpp"

#include <algorithm>

namespace tether::test {
namespace {

bool moves(const Twist& twist) { return twist.v_mps != 0.0 || twist.omega_radps != 0.0; }

}  // namespace

/// Within the limits of setpoints.
Twist FaultyDriver::nearer(const Twist& target) const {
  const double dv = target.v_mps - before_.v_mps, dw = target.omega_radps - before_.omega_radps;
  return {before_.v_mps + std::clamp(dv, -most_mps_, most_mps_),
          before_.omega_radps + std::clamp(dw, -most_radps_, most_radps_)};
}

void FaultyDriver::spoil(Instant now, OnboardDriver::Output& out) {
  spoil_law(now, out);
  spoil_remote(out);
  if (fault_ == Fault::rolls_on && out.driver == Driver::none) out.setpoint = before_;
  before_ = out.setpoint;
}

void FaultyDriver::spoil_law(Instant now, OnboardDriver::Output& out) {
  if (fault_ == Fault::starts_early && now < kStart && now > kStart - std::chrono::seconds{1}) {
    out.state = DriveState::autonomous;
    out.driver = Driver::law;
    out.setpoint = nearer({1.0, 0.0});
  }
  if (fault_ == Fault::jumps && out.driver == Driver::law && moves(before_)) {
    out.setpoint = {before_.v_mps + 1.1 * most_mps_, before_.omega_radps};
  }
  if (fault_ == Fault::two_drivers && out.driver == Driver::law && moves(before_)) {
    turn_ = !turn_;
    if (turn_) out.driver = Driver::remote;
  }
  if (fault_ == Fault::law_unasked && out.state == DriveState::protective_stop &&
      !moves(out.setpoint)) {
    out.driver = Driver::law;
    out.setpoint = nearer({1.0, 0.0});
  }
}

void FaultyDriver::spoil_remote(OnboardDriver::Output& out) {
  if (fault_ == Fault::remote_unasked && out.state == DriveState::remote_requested) {
    out.driver = Driver::remote;
    out.setpoint = nearer({0.5, 0.0});
  }
  if (fault_ == Fault::remote_forever) {
    began_ =
        began_ || (out.state == DriveState::remote && out.driver == Driver::none && moves(before_));
    if (!began_) return;
    out.state = DriveState::remote;
    out.driver = Driver::remote;
    out.setpoint = before_;
  }
  if (fault_ == Fault::remote_fast && out.state == DriveState::remote) {
    const bool drives = out.driver == Driver::remote && moves(out.setpoint);
    out.setpoint = nearer(drives ? Twist{2.0, out.setpoint.omega_radps} : out.setpoint);
  }
}

Twist FaultyDriver::wheels(Instant now, const OnboardDriver::Output& out) {
  if (out.state != DriveState::protective_stop)
    stopping_ = Instant::max();
  else if (stopping_ == Instant::max())
    stopping_ = now;
  const bool heeds =
      stopping_ == Instant::max() || now - stopping_ >= std::chrono::milliseconds{500};
  if (fault_ != Fault::stops_late || heeds) told_ = out.setpoint;
  return told_;
}

}  // namespace tether::test
