#include "can_bridge/safety/safety_core.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

namespace tether {
namespace {

double whole_ms(Duration d) { return std::floor(to_milliseconds(d)); }

BlindBudget::Config budget(const SafetyCore::Config& config) {
  return {config.max_blind,
          config.max_blind_m,
          config.limits.max_deceleration_mps2,
          config.limits.max_yaw_deceleration_radps2,
          TwistLimiter::kStopJerkDelay + 4 * config.limits.cycle,
          config.drives_stop_mps2.value_or(config.limits.max_deceleration_mps2),
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

}  // namespace tether
