#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/safety/safety_core.hpp"
#include "common/vehicle/diff_drive.hpp"

// Following commands, and coming to rest from there.

namespace tether {

void SafetyCore::begin_following(Instant now, const DrivetrainSnapshot& drives) {
  // The command was fresh and zero when ARM was pressed, but it may have changed while the drives
  // switched on. The vehicle must not start to move just because they are on now.
  if (commands_.age(now).value_or(Duration::max()) >= config_.stale) {
    begin_quick_stop(now, "the command was not fresh when the drives were on: arm again");
    return;
  }
  if (const std::string why = why_no_plan_arms(now); !why.empty()) {
    begin_quick_stop(now, why + ": arm again");
    return;
  }
  if (!commands_.is_zero(now)) {
    begin_quick_stop(now, "the command was not zero when the drives were on: arm again");
    return;
  }
  if (!drives.standstill) {
    begin_quick_stop(now, "the wheels turned when the drives were on: arm again at standstill");
    return;
  }
  motion_ = Motion::following;
  motion_since_ = now;
  slowed_by_budget_ = stale_ = false;
  limiter_.reset();
  monitor_.reset();
  witnesses_.reset();
  ramp_watch_.end();
  follow(now, drives);
}

void SafetyCore::follow(Instant now, const DrivetrainSnapshot& drives) {
  const Duration age = commands_.age(now).value_or(Duration::max());
  watch_age(age);
  if (!stale_ && demands_.stop.empty()) {
    ramp_watch_.end();
    follow_within_budget(permitted(commands_.twist(now)), commands_.follows_plan(now));
  } else if (age < config_.disarm) {
    limiter_.stop();
    watch_ramp(now, drives);
  } else {
    begin_quick_stop(now, commands_.age_text(now, "was") +
                              ": check the controller and the network; arm again with a zero "
                              "command");
  }
}

void SafetyCore::follow_within_budget(const Twist& wanted, bool planned) {
  const Twist possible = limiter_.within_speed_limits(wanted);
  const double share = planned ? budget_.share(possible) : 1.0;
  const bool too_fast = planned && budget_.share(limiter_.twist()) < 1.0;
  slowed_by_budget_ = share < 1.0;
  Twist target{share * possible.v_mps, share * possible.omega_radps};
  if (planned) {
    const double most_mps = budget_.speed_beside(limiter_.twist().omega_radps);
    target.v_mps = std::clamp(target.v_mps, -most_mps, most_mps);
  }
  if (too_fast) {
    limiter_.brake_to(target);
  } else {
    limiter_.step(target);
  }
}

void SafetyCore::watch_age(Duration age) {
  const bool too_old = age >= config_.stale;
  const bool too_far = to_seconds(age) * std::abs(limiter_.twist().v_mps) >= config_.max_stale_m;
  // Once stale, it stays so until a newer one comes, though the vehicle is slower then.
  stale_ = too_old || too_far || (stale_ && age > last_age_);
  last_age_ = age;
}

void SafetyCore::begin_ramp_down(const std::string& why, Instant now) {
  if (motion_ == Motion::enabling) begin_quick_stop(now, why);
  if (motion_ != Motion::following) return;
  count_disarm();
  commands_.end_plans(now);
  motion_ = Motion::ramping;
  ramp_watch_.end();
  setpoint_zero_since_.reset();
  stop_reason_ = why;
}

void SafetyCore::ramp_down(Instant now, const DrivetrainSnapshot& drives) {
  limiter_.stop();
  watch_ramp(now, drives);
  if (motion_ != Motion::ramping || !limiter_.at_rest()) return;
  if (!setpoint_zero_since_) setpoint_zero_since_ = now;
  if (drives.standstill) {
    motion_ = Motion::stopping;
    motion_since_ = now;
    disable_sent_ = true;
    stop_overdue_ = false;
    distrust_until_.reset();
    action_ = Decision::Action::disable;
  } else if (now - *setpoint_zero_since_ >= kStandstillWait) {
    begin_quick_stop(now, "the wheels still turned after the ramp to zero");
  }
}

void SafetyCore::watch_ramp(Instant now, const DrivetrainSnapshot& drives) {
  const WheelSpeeds rims{drives.wheels[0].fastest_radps * config_.wheel_radius_m,
                         drives.wheels[1].fastest_radps * config_.wheel_radius_m};
  const Twist measured = to_twist(rims, config_.limits.track_m);
  if (ramp_watch_.brakes(now, limiter_.twist(), measured)) return;
  latch_fault(
      fmt::format("the vehicle does not brake on the ramp: {:.2f} m/s, {:.2f} rad/s: check "
                  "the drives' ramps (0x6084), load and slope",
                  measured.v_mps, measured.omega_radps));
  begin_quick_stop(now, fault_reason_);
}

void SafetyCore::finish_stop(Instant now, const DrivetrainSnapshot& drives) {
  const bool believed = !distrust_until_ || now >= *distrust_until_;
  switch (drives.phase) {
    case DrivePhase::starting:
    case DrivePhase::refused:
    case DrivePhase::faulted:
      motion_ = Motion::idle;
      return;
    case DrivePhase::standby:
      if (now != motion_since_) {
        motion_ = Motion::idle;
        return;
      }
      // The stop began in this cycle, and the drives show standby because they have not yet acted
      // on the request to enable them. They get a stop, or they would still switch on.
      action_ = Decision::Action::quick_stop;
      break;
    case DrivePhase::enabling:
    case DrivePhase::enabled:
      if (!disable_sent_) action_ = Decision::Action::quick_stop;
      break;
    case DrivePhase::stopping:
      if (drives.standstill && drives.feedback_fresh && believed && !disable_sent_) {
        disable_sent_ = true;
        action_ = Decision::Action::disable;
      }
      break;
  }
  const Instant since = distrust_until_.value_or(motion_since_);
  if (drives.standstill && now - since >= kStopTimeout && !stop_overdue_) {
    stop_overdue_ = true;
    latch_fault("the drives do not confirm that their power is off");
  }
}

void SafetyCore::watch_standstill(Instant now, const DrivetrainSnapshot& drives) {
  const bool believed = !distrust_until_ || now >= *distrust_until_;
  // Drives that have stopped and are off may fall silent.
  const bool stands = drives.feedback_fresh ? drives.standstill : !drives.in_doubt;
  if (stands && believed) {
    standstill_due_.reset();
    const bool until_reset = latched() || drives.phase == DrivePhase::refused;
    unconfirmed_ = unconfirmed_ && until_reset;
  } else if (standstill_due_ && now >= *standstill_due_ && !unconfirmed_) {
    unconfirmed_ = stop_overdue_ = true;
    latch_fault("no confirmed standstill 5 s after the stop began");
  }
}

}  // namespace tether
