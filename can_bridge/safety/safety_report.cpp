#include <fmt/format.h>

#include <cmath>

#include "can_bridge/safety/safety_core.hpp"

// The safety core's state and reason, in words.

namespace tether {

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
