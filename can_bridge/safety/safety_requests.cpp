#include <fmt/format.h>

#include <cmath>

#include "can_bridge/safety/safety_core.hpp"

// Requests of operators to the safety core: arming, stopping, resetting.

namespace tether {

void SafetyCore::handle(DriveRequest request, Instant now, const DrivetrainSnapshot& drives,
                        CanState bus) {
  switch (request) {
    case DriveRequest::arm:
      return arm(now, drives, bus);
    case DriveRequest::disarm:
      if (motion_ == Motion::idle) commands_.end_plans(now);
      return begin_ramp_down("disarmed by request", now);
    case DriveRequest::estop:
      estop_pressed_ = true;
      estop_latched_ = true;
      estop_restored_.clear();
      reset_since_.reset();
      notice_.clear();
      return;
    case DriveRequest::estop_release:
      if (!demands_.no_release.empty()) {
        notice_ = "release refused";
        return;
      }
      estop_pressed_ = false;
      notice_.clear();
      return;
    case DriveRequest::reset:
      return reset(now, drives, bus);
    case DriveRequest::alive:  // acts on arrival
      return;
  }
}

bool SafetyCore::is_held(Instant now) const {
  if (config_.operator_timeout == Duration{0}) return true;
  return held_ && now - *held_ < config_.operator_timeout;
}

void SafetyCore::restore_estop(std::string why) {
  estop_pressed_ = estop_latched_ = true;
  estop_restored_ = std::move(why);
}

void SafetyCore::arm(Instant now, const DrivetrainSnapshot& drives, CanState bus) {
  if (motion_ == Motion::enabling || motion_ == Motion::following) return;
  const std::string obstacle = obstacle_to_arming(now, drives, bus);
  if (!obstacle.empty()) {
    notice_ = "arming refused: " + obstacle;
    return;
  }
  notice_.clear();
  stop_reason_.clear();
  feedback_lies_ = false;
  did_not_follow_ = false;
  distrust_until_.reset();
  motion_ = Motion::enabling;
  motion_since_ = now;
  action_ = Decision::Action::enable;
}

std::string SafetyCore::obstacle_to_arming(Instant now, const DrivetrainSnapshot& drives,
                                           CanState bus) const {
  if (leaving_since_) return "the bridge is being shut down";
  if (estop_latched_) return "the e-stop is latched: release it, then reset";
  if (fault_latched_) return "a fault is latched: mend it, then reset";
  if (!demands_.stop.empty()) return demands_.stop;
  if (!demands_.no_release.empty()) return demands_.no_release;
  if (!demands_.no_arming.empty()) return demands_.no_arming;
  if (motion_ != Motion::idle) return "the vehicle is still stopping";
  if (action_ != Decision::Action::none) return "the drives are just being reset";
  if (bus != CanState::up) return fmt::format("the CAN bus is {}", to_string(bus));
  if (drives.phase != DrivePhase::standby) {
    return fmt::format("the drives are not ready: {}", to_string(drives.phase));
  }
  if (!is_held(now)) {
    return fmt::format(
        "hold-to-run is released (can.operator_timeout_ms = {:.0f}): tether can hold",
        to_milliseconds(config_.operator_timeout));
  }
  if (!drives.feedback_fresh) return "wheel feedback is missing";
  if (!drives.standstill) return "the wheels are turning: wait for standstill";

  const auto age = commands_.age(now);
  if (!age && commands_.blind() > 0) {
    return "all commands were made from poses older than can.max_blind_s (pose_utime): check the "
           "poses' way to the controller";
  }
  if (!age) return "there is no command yet: start the controller; it has to send zero";
  if (*age >= config_.stale) {
    return fmt::format(
        "{} (limit {:.0f} ms): check the controller, the network and both hosts' clocks",
        commands_.age_text(now, "is"), to_milliseconds(config_.stale));
  }
  if (std::string why = why_no_plan_arms(now); !why.empty()) return why;
  if (!commands_.is_zero(now)) {
    const Twist twist = commands_.twist(now);
    return fmt::format("the newest command is not zero ({:.3f} m/s, {:.3f} rad/s)", twist.v_mps,
                       twist.omega_radps);
  }
  return "";
}

std::string SafetyCore::why_no_plan_arms(Instant now) const {
  const bool over = commands_.follows_plan(now) && commands_.age(now) > Duration{0};
  if (over) return commands_.age_text(now, "is");  // its ramp is zero, whatever it said
  const auto silence = commands_.plan_silence(now);
  if (!silence || *silence < kPlanSilence) return "";
  if (*silence == Duration::max()) {
    return "the only plan is a preload: the controller has to send plans through the network, too";
  }
  return fmt::format("the newest plan is {:.0f} ms old (limit {:.0f} ms): is the controller alive?",
                     std::floor(to_milliseconds(*silence)), to_milliseconds(kPlanSilence));
}

void SafetyCore::reset(Instant now, const DrivetrainSnapshot& drives, CanState bus) {
  if (!latched() && drives.phase != DrivePhase::refused) return;
  if (motion_ != Motion::idle) {
    notice_ = "reset refused: the vehicle is still stopping";
  } else if (estop_pressed_ || !demands_.estop.empty()) {
    notice_ = "reset refused: the e-stop is pressed: release it first";
  } else if (turning_) {
    notice_ = drives.turning
                  ? "reset refused: the wheels are still turning: wait for standstill"
                  : "reset refused: standstill is not confirmed: by its last report and its ramp, "
                    "a wheel may still turn: wait, then reset again";
  } else if (drives.phase == DrivePhase::standby && !drives.feedback_fresh && drives.in_doubt) {
    notice_ = "reset refused: wheel feedback is missing: check the drives and the CAN plug";
  } else if (did_not_follow_ && distrust_until_ && now < *distrust_until_) {
    notice_ = fmt::format(
        "reset refused: a wheel's feedback was wrong, so its standstill is not believed for "
        "another {:.1f} s: look whether the wheels stand",
        to_seconds(*distrust_until_ - now));
  } else if (did_not_follow_ && drives.feedback_fresh && drives.in_doubt) {
    notice_ = "reset refused: a wheel's feedback was wrong, and its drive does not show power off";
  } else if (bus == CanState::absent || (bus == CanState::down && !restart_unfinished_)) {
    notice_ = fmt::format("reset refused: the CAN interface is {}", to_string(bus));
  } else if (bus_was_jammed_ || restart_unfinished_) {
    notice_ = "reset: restarting the CAN interface";
    action_ = Decision::Action::restart_bus;
    reset_since_ = now;
  } else {
    finish_reset(now);
  }
}

void SafetyCore::on_bus_restarted(bool done, const std::string& why) {
  purge_due_ = false;
  if (done) {
    bus_was_jammed_ = false;
    worst_bus_ = CanState::up;  // forgets what the restart has put right
    return;
  }
  restart_unfinished_ = worst_bus_ == CanState::down;
  if (reset_since_) {
    notice_ = "reset refused: " + why;
  } else {
    purge_failure_ = why;
  }
  reset_since_.reset();
}

void SafetyCore::wait_for_restarted_bus(Instant now, CanState bus) {
  if (!reset_since_) return;
  if (bus == CanState::up || bus == CanState::error_passive) {
    finish_reset(now);
  } else if (now - *reset_since_ >= kBusRestartWait) {
    notice_ = fmt::format("reset refused: the CAN bus is still {} after a restart", to_string(bus));
    reset_since_.reset();
  }
}

void SafetyCore::finish_reset(Instant now) {
  commands_.end_plans(now);
  commands_.forget_senders();
  // Harmless where the drives have no fault: the profile ignores it then.
  action_ = Decision::Action::reset_fault;
  estop_latched_ = false;
  fault_latched_ = false;
  standstill_due_.reset();  // start-up asks the drives
  bus_was_jammed_ = false;
  purged_ = false;
  reset_since_.reset();
  fault_reason_.clear();
  purge_failure_.clear();
  estop_restored_.clear();
  stop_reason_.clear();
  notice_.clear();
}

}  // namespace tether
