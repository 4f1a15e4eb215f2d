#include "can_bridge/safety/safety_core.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "common/vehicle/diff_drive.hpp"

namespace tether {
namespace {

double whole_ms(Duration d) { return std::floor(to_milliseconds(d)); }

BlindBudget::Config budget(const SafetyCore::Config& config) {
  return {config.max_blind,
          config.max_blind_m,
          config.limits.max_deceleration_mps2,
          config.limits.max_yaw_deceleration_radps2,
          TwistLimiter::kStopJerkDelay + 4 * config.limits.cycle,
          TwistLimiter::kStopJerkDelay + config.drives_stop.deadline + 4 * config.limits.cycle,
          config.drives_stop.mps2.value_or(config.limits.max_deceleration_mps2),
          config.limits.track_m / 2.0};
}

/// A witness says so, or fresh feedback does not say that both stand.
bool may_turn(const DrivetrainSnapshot& drives) {
  return drives.turning || (drives.feedback_fresh && !drives.standstill);
}

bool is_stop(const Twist& u) { return u.v_mps == 0.0 && u.omega_radps == 0.0; }

}  // namespace

SafetyCore::SafetyCore(const Config& config)
    : config_(config),
      commands_({std::min(kMaxAhead, config.stale / 2), config.earliest}, config.actuator,
                config.vehicle, config.max_blind),
      budget_(budget(config)),
      request_guard_(config.earliest),
      limiter_(config.limits),
      monitor_(config.limits.track_m, config.wheel_radius_m),
      witnesses_(config.limits.track_m, config.wheel_radius_m),
      ramp_watch_(config.limits.max_deceleration_mps2, config.limits.max_yaw_deceleration_radps2) {
  assert(config.stale > Duration{0});
  assert(config.disarm >= config.stale);
}

void SafetyCore::on_command(Instant now, Instant stamp, std::int64_t seq, const Twist& twist,
                            std::optional<Instant> pose) {
  if (motion_ != Motion::idle && commands_.follows_plan(now) && !is_stop(twist)) {
    ++twists_against_plans_;
    return;
  }
  commands_.offer(now, stamp, seq, twist, pose);
}

void SafetyCore::on_plan(Instant now, PlanSource source, Plan plan) {
  if (source == PlanSource::preload && motion_ != Motion::idle) {
    ++late_preloads_;
    return;
  }
  commands_.hold_session(motion_ != Motion::idle);
  commands_.accept_any_stop(motion_ == Motion::following);
  const bool foreign = commands_.takes_plans() && plan.name.session != commands_.session();
  if (motion_ != Motion::idle && foreign && plan.is_stop()) {
    ++foreign_stops_;
    foreign_stop_due_ = true;
  }
  commands_.offer(now, source, std::move(plan));
}

void SafetyCore::on_request(Instant now, Instant stamp, std::int64_t seq, std::int32_t request) {
  request_guard_.start(now);
  const auto accepted = request_guard_.accept(now, stamp, seq, request);
  if (accepted == DriveRequest::alive) {
    held_ = std::min(now, stamp);
  } else if (accepted) {
    requests_.push_back(*accepted);
  }
}

void SafetyCore::on_bus_state(CanState bus) { worst_bus_ = std::max(worst_bus_, bus); }

void SafetyCore::list(CounterList& out) const {
  commands_.list(out);
  request_guard_.list(out);
  out.emplace_back("disarms", disarms_);
  if (late_preloads_ > 0) out.emplace_back("plan.preload_while_armed", late_preloads_);
  if (twists_against_plans_ > 0) out.emplace_back("command.against_plan", twists_against_plans_);
  if (foreign_stops_ > 0) out.emplace_back("plan.stop_of_other_session", foreign_stops_);
}

Decision SafetyCore::cycle(Instant now, const DrivetrainSnapshot& drives, CanState bus,
                           double driven_m) {
  action_ = Decision::Action::none;
  request_guard_.start(now);
  budget_.update(now, driven_m, commands_.seen());
  watch_own_loop(now);
  watch_bus(bus);
  watch_drives(now, drives);
  watch_senders(now);
  wait_for_restarted_bus(now, bus);
  for (const DriveRequest request : requests_) handle(request, now, drives, bus);
  requests_.clear();
  obey_inputs(now, drives, bus);
  const bool must_stop = latched() || leaving_since_;
  if (must_stop && motion_ != Motion::idle && motion_ != Motion::stopping) {
    begin_quick_stop(now, latched() ? latched_reason() : "the bridge is being shut down");
  }
  advance(now, drives);
  watch_standstill(now, drives);
  purge_bus();

  Decision decision;
  decision.state = state(drives);
  decision.reason = reason(decision.state, now, drives, bus);
  decision.action = action_;
  decision.estop_latched = estop_latched_;
  decision.distrust_until = distrust_until_;
  decision.may_move = motion_ == Motion::following || motion_ == Motion::ramping;
  if (decision.may_move) decision.twist = limiter_.twist();
  return decision;
}

void SafetyCore::watch_own_loop(Instant now) {
  if (last_cycle_ && now - *last_cycle_ > config_.disarm) {
    latch_fault(
        fmt::format("the bridge itself stood still for {:.0f} ms: suspended or starved of "
                    "CPU time; reset, then arm",
                    whole_ms(now - *last_cycle_)));
  }
  last_cycle_ = now;
}

void SafetyCore::watch_senders(Instant now) {
  if (!several_senders_.empty()) {
    latch_fault(
        fmt::format("two programs command this vehicle, on {}: leave one of them, then reset",
                    several_senders_));
  }
  if (commands_.two_senders()) {
    latch_fault("two senders take turns to command this vehicle: leave one of them, then reset");
  }
  if (!is_held(now)) begin_ramp_down("hold-to-run released", now);
  if (std::exchange(foreign_stop_due_, false)) {
    begin_ramp_down("a controller of another session said to stand still", now);
  }
}

void SafetyCore::watch_bus(CanState bus) {
  const CanState worst = std::max(worst_bus_, bus);
  worst_bus_ = bus;
  is_unheard_ = worst != CanState::up && worst != CanState::error_passive;
  if (worst == CanState::bus_off || worst == CanState::stalled) bus_was_jammed_ = true;
  // An interface that is down or gone has dropped its queue: no old frame is left.
  if (bus == CanState::down || bus == CanState::absent) bus_was_jammed_ = false;
  if (bus != CanState::down) restart_unfinished_ = false;
  if (worst == CanState::stalled && !purged_) purge_due_ = purged_ = true;
  switch (worst) {
    case CanState::up:
    case CanState::error_passive:
      return;
    case CanState::stalled:
      return latch_fault(
          "CAN bus stalled: no device acknowledges the frames: check the drives' supply, plug and "
          "bit rate");
    case CanState::bus_off:
      return latch_fault(
          "CAN bus-off: check for a short circuit, termination (2 x 120 ohm) and bit rate");
    case CanState::down:
      return latch_fault("CAN interface down: bring it up (ip link set … up)");
    case CanState::absent:
      return latch_fault("CAN interface absent: plug the adapter in");
  }
}

void SafetyCore::purge_bus() {
  // There is one action in a cycle, and a stop is more urgent.
  if (!purge_due_ || action_ != Decision::Action::none) return;
  purge_due_ = false;
  action_ = Decision::Action::restart_bus;
}

void SafetyCore::watch_drives(Instant now, const DrivetrainSnapshot& drives) {
  const DrivePhase phase = drives.phase;
  // A refusal's reason is out of date once the drives have gone on.
  if (phase != last_phase_) notice_.clear();
  last_phase_ = phase;
  if (phase == DrivePhase::starting || phase == DrivePhase::refused) witnesses_.demand_proof();
  turning_ = may_turn(drives);
  in_doubt_ = drives.in_doubt;
  fastest_rim_mps_ = 0.0;
  for (const WheelFeedback& wheel : drives.wheels) {
    for (const double radps : {wheel.speed_radps, wheel.fastest_radps}) {
      fastest_rim_mps_ = std::max(fastest_rim_mps_, config_.wheel_radius_m * std::abs(radps));
    }
  }
  if (phase == DrivePhase::faulted) {
    latch_fault(drives.reason, Cause::drives);
    // Take the profile's newest reason: it may learn the error code, or why feedback is missing,
    // only later.
    if (fault_cause_ == Cause::drives) fault_reason_ = drives.reason;
  }
  const bool power_on = phase == DrivePhase::enabled || phase == DrivePhase::enabling;
  if (motion_ == Motion::idle && power_on) {
    latch_fault("the drives' power stages are on without ARM");
    begin_quick_stop(now, fault_reason_);
  }
  if (motion_ == Motion::idle || motion_ == Motion::stopping) return;
  const bool as_wanted = motion_ == Motion::enabling ? power_on || phase == DrivePhase::standby
                                                     : phase == DrivePhase::enabled;
  if (!as_wanted) {
    latch_fault(fmt::format("the drives left operation by themselves: {}",
                            drives.reason.empty() ? to_string(phase) : drives.reason),
                Cause::drives);
  } else if (!drives.feedback_fresh) {
    latch_fault("wheel feedback is missing: check the drives, the CAN plug and the bus load",
                Cause::drives);
    feedback_lies_ = true;
  } else if (motion_ != Motion::enabling) {
    // The witnesses come first, because they say which of them is wrong.
    std::string trouble = witnesses_.update(now, limiter_.twist(), drives.wheels);
    const std::string behind = monitor_.update(now, limiter_.twist(), drives.wheels);
    if (trouble.empty() && !behind.empty()) trouble = witnesses_.suspicion();
    if (trouble.empty()) trouble = behind;
    if (trouble.empty()) return;
    latch_fault(trouble);
    feedback_lies_ = did_not_follow_ = true;
  }
}

void SafetyCore::latch_fault(const std::string& reason, Cause cause) {
  if (fault_latched_) return;
  fault_latched_ = true;
  fault_cause_ = cause;
  fault_reason_ = reason;
  notice_.clear();
}

void SafetyCore::count_disarm() {
  if (motion_ == Motion::following) ++disarms_;
}

void SafetyCore::begin_quick_stop(Instant now, const std::string& why) {
  count_disarm();
  commands_.end_plans(now);
  motion_ = Motion::stopping;
  motion_since_ = now;
  disable_sent_ = false;
  stop_overdue_ = false;
  distrust_until_.reset();
  // A stop that does not arrive begins only when the drives' own deadlines are over.
  if (feedback_lies_ || is_unheard_) {
    distrust_until_ = now + braking_time(limiter_.twist()) + kDistrustMargin;
  }
  standstill_due_ = distrust_until_.value_or(now) + kStopTimeout;
  stop_reason_ = why;
}

Duration SafetyCore::braking_time(const Twist& from) const {
  return from_seconds(
      std::max(std::abs(from.v_mps) / config_.limits.max_deceleration_mps2,
               std::abs(from.omega_radps) / config_.limits.max_yaw_deceleration_radps2));
}

void SafetyCore::advance(Instant now, const DrivetrainSnapshot& drives) {
  switch (motion_) {
    case Motion::idle:
      return;
    case Motion::enabling:
      if (drives.phase == DrivePhase::enabled) {
        begin_following(now, drives);
      } else if (now - motion_since_ >= kEnableTimeout) {
        begin_quick_stop(now, "arming failed: the drives did not switch on: " + drives.reason);
      }
      break;
    case Motion::following:
      follow(now, drives);
      break;
    case Motion::ramping:
      ramp_down(now, drives);
      break;
    case Motion::stopping:
      break;
  }
  if (motion_ == Motion::stopping) finish_stop(now, drives);
}

void SafetyCore::leave(Instant now) {
  if (!leaving_since_) leaving_since_ = now;
}

bool SafetyCore::has_left(Instant now) const {
  if (!leaving_since_) return false;
  if (now - *leaving_since_ >= leave_wait()) return true;
  const bool a_cycle_since = last_cycle_ && *last_cycle_ > *leaving_since_;
  return a_cycle_since && motion_ == Motion::idle && !powered() && !turning_ && !in_doubt_;
}

Duration SafetyCore::leave_wait() const {
  const TwistLimits& limits = config_.limits;
  const Twist fastest{std::max(limits.max_speed_mps, limits.max_reverse_mps),
                      limits.max_yaw_rate_radps};
  return std::min(braking_time(fastest) + kLeaveMargin, kLongestLeave);
}

bool SafetyCore::powered() const {
  return last_phase_ == DrivePhase::enabling || last_phase_ == DrivePhase::enabled ||
         last_phase_ == DrivePhase::stopping;
}

// Requests of operators to the safety core: arming, stopping, resetting.

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

// Demands of the vehicle's safety inputs on the safety core.

namespace {

constexpr const char* kArmAgain = ": arm again when it is clear";

}  // namespace

void SafetyCore::obey_inputs(Instant now, const DrivetrainSnapshot& drives, CanState bus) {
  if (!demands_.estop.empty()) {
    estop_latched_ = true;
    reset_since_.reset();
  }
  if (demands_.stop.empty() || motion_ == Motion::idle || motion_ == Motion::stopping) return;
  const bool following = motion_ == Motion::following;
  if (following && demands_.may_resume) return;  // follow() ramps, and goes on
  if (demands_.ramp && motion_ != Motion::enabling) {
    if (!following) return;  // it ramps already
    handle(DriveRequest::disarm, now, drives, bus);
    stop_reason_ = demands_.stop + kArmAgain;
    return;
  }
  begin_quick_stop(now, demands_.stop + kArmAgain);
}

Twist SafetyCore::permitted(const Twist& twist) const {
  if (!demands_.speed_limit_mps) return twist;
  const WheelSpeeds rims = to_wheel_speeds(twist, config_.limits.track_m);
  const double fastest_mps = std::max(std::abs(rims.left_mps), std::abs(rims.right_mps));
  const double scale = std::min(1.0, *demands_.speed_limit_mps / std::max(fastest_mps, 1e-9));
  return {twist.v_mps * scale, twist.omega_radps * scale};
}

std::string SafetyCore::inputs_reason() const {
  if (!demands_.stop.empty()) return demands_.stop + ": stands until then";
  if (!demands_.speed_limit_mps) return "";
  return fmt::format("limited to {:g} m/s by {}", *demands_.speed_limit_mps,
                     demands_.speed_limit_by);
}

// Following commands, and coming to rest from there.

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

// The safety core's state and reason, in words.

const char* to_string(BridgeState state) {
  switch (state) {
    case BridgeState::starting:
      return "starting";
    case BridgeState::refused:
      return "refused";
    case BridgeState::disarmed:
      return "disarmed";
    case BridgeState::arming:
      return "arming";
    case BridgeState::armed:
      return "armed";
    case BridgeState::stopping:
      return "stopping";
    case BridgeState::fault:
      return "fault";
    case BridgeState::estop:
      return "estop";
    case BridgeState::unconfirmed:
      return "unconfirmed";
  }
  return "?";
}

BridgeState SafetyCore::state(const DrivetrainSnapshot& drives) const {
  switch (motion_) {
    case Motion::enabling:
      return BridgeState::arming;
    case Motion::following:
      return BridgeState::armed;
    case Motion::ramping:
      return BridgeState::stopping;
    case Motion::stopping:
      if (!stop_overdue_) return BridgeState::stopping;
      break;
    case Motion::idle:
      break;
  }
  if (estop_latched_) return BridgeState::estop;
  if (fault_latched_) return unconfirmed_ ? BridgeState::unconfirmed : BridgeState::fault;
  switch (drives.phase) {
    case DrivePhase::refused:
      return unconfirmed_ ? BridgeState::unconfirmed : BridgeState::refused;
    case DrivePhase::standby:
      return BridgeState::disarmed;
    case DrivePhase::stopping:
      return BridgeState::stopping;
    case DrivePhase::starting:
    case DrivePhase::enabling:
    case DrivePhase::enabled:
    case DrivePhase::faulted:
      break;
  }
  return BridgeState::starting;
}

std::string SafetyCore::reason(BridgeState state, Instant now, const DrivetrainSnapshot& drives,
                               CanState bus) const {
  std::string text;
  switch (state) {
    case BridgeState::starting:
    case BridgeState::refused:
      text = drives.reason;
      if (!notice_.empty()) text += "; " + notice_;
      break;
    case BridgeState::disarmed:
      text = !notice_.empty() ? notice_ : stop_reason_;
      if (text.empty()) text = !demands_.stop.empty() ? demands_.stop : demands_.no_arming;
      if (text.empty()) text = "ready to be armed";
      break;
    case BridgeState::arming:
      text = "the drives are being switched on";
      break;
    case BridgeState::armed:
      text = armed_reason(now);
      break;
    case BridgeState::stopping:
      text = latched() ? latched_reason() : stop_reason_;
      break;
    case BridgeState::fault:
    case BridgeState::estop:
    case BridgeState::unconfirmed:
      text = latched() ? latched_reason() : drives.reason;
      if (!notice_.empty()) text += "; " + notice_;
      break;
  }
  if (!demands_.no_release.empty() && text.find(demands_.no_release) == std::string::npos) {
    text += (text.empty() ? "" : "; ") + demands_.no_release;
  }
  if (bus == CanState::error_passive) {
    text += text.empty() ? "" : "; ";
    text += "the CAN controller is error-passive: check wiring, termination and bit rate";
  }
  return text;
}

std::string SafetyCore::armed_reason(Instant now) const {
  if (!stale_ && slowed_by_budget_) {
    return fmt::format(
        "slowed: the vehicle is unseen for {:.2f} s and {:.2f} m (can.max_blind_s = {}, "
        "can.max_blind_m = {})",
        to_seconds(budget_.blind()), budget_.blind_m(), to_seconds(config_.max_blind),
        config_.max_blind_m);
  }
  if (!stale_) return inputs_reason();
  return commands_.age_text(now, "is") + ": ramping to zero";
}

std::string SafetyCore::latched_reason() const {
  std::string fault =
      purge_failure_.empty()
          ? fault_reason_
          : fmt::format("{}; setpoints of before may still come out when the bus recovers: {}",
                        fault_reason_, purge_failure_);
  if (unconfirmed_) {
    fault += standstill_due_
                 ? (turning_ ? "; the wheels still turn: use the hard-wired emergency stop"
                             : "; no two witnesses of each wheel say that it stands: look "
                               "whether it does")
                 : "; two witnesses of each wheel say now that it stands";
  }
  if (!estop_latched_) return fault;
  const std::string from_start =
      estop_restored_.empty() ? "" : fmt::format(" (from the start: {})", estop_restored_);
  std::string text = estop_pressed_
                         ? fmt::format("e-stop pressed{}: release it, then reset", from_start)
                         : "e-stop released: reset to go on";
  if (!demands_.estop.empty()) text = demands_.estop + ": release it, then reset";
  if (fault_latched_) text += "; also: " + fault;
  return text;
}

std::string SafetyCore::left_behind() const {
  if (!leaving_since_ || !(powered() || turning_ || in_doubt_)) return "";
  return fmt::format(
      "the bridge ends although {}, power stages {}: the drives' own watchdogs have to stop the "
      "vehicle: use the hard-wired emergency stop",
      turning_ ? fmt::format("the wheels turn at {:.2f} m/s", fastest_rim_mps_)
               : "standstill and power off are not confirmed",
      powered()   ? "on"
      : in_doubt_ ? "perhaps on"
                  : "off");
}

}  // namespace tether
