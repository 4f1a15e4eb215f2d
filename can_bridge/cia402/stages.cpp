// Cia402Profile: which stage follows which, and why.
#include <fmt/format.h>

#include <algorithm>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/cia402/profile.hpp"
#include "can_bridge/cia402/startup.hpp"
#include "can_bridge/cia402/texts.hpp"

namespace tether {
namespace {

using canopen::DriveState;
using canopen::NmtState;

constexpr Duration kStopTimeout = std::chrono::seconds(5);
constexpr int kTop = 3;

/// How far up the way to OperationEnabled; −1 where it has not begun.
int height(std::optional<DriveState> state) {
  if (!state) return -1;
  switch (*state) {
    case DriveState::switch_on_disabled:
      return 0;
    case DriveState::ready_to_switch_on:
      return 1;
    case DriveState::switched_on:
      return 2;
    case DriveState::operation_enabled:
      return kTop;
    case DriveState::not_ready:
    case DriveState::quick_stop_active:
    case DriveState::fault_reaction:
    case DriveState::fault:
      break;
  }
  return -1;
}

bool is_stop(std::uint16_t controlword) {
  return controlword == canopen::kControlQuickStop ||
         controlword == canopen::kControlDisableVoltage;
}

bool powered(std::optional<DriveState> state) {
  return state == DriveState::switched_on || state == DriveState::operation_enabled ||
         state == DriveState::quick_stop_active;
}

}  // namespace

void Cia402Profile::enter(Stage stage) {
  stage_ = stage;
  stage_since_.reset();
  reason_.clear();
}

bool Cia402Profile::supervised() const {
  return stage_ >= Stage::settling && stage_ != Stage::refused && commanding_;
}

void Cia402Profile::fault(const std::string& reason, bool needs_restart, Cause cause) {
  if (stage_ == Stage::idle || stage_ == Stage::refused) return;
  needs_restart_ = needs_restart_ || needs_restart || stage_ < Stage::settling;
  if (stage_ == Stage::faulted) {
    // Missing feedback is often only the first sign of what is wrong.
    if (cause_ != Cause::feedback || cause == Cause::feedback) return;
  } else {
    enter(Stage::faulted);
    released_ = {};
  }
  reason_ = reason;
  cause_ = cause;
  fault_axis_.reset();
}

void Cia402Profile::fault_of_axis(std::size_t i, const char* what) {
  fault(fmt::format("{}: fault{}, error code not known yet: remove the cause, then reset",
                    axes_[i].name(), what),
        false);
  fault_axis_ = i;
  fault_what_ = what;
  tell_error_code();
}

void Cia402Profile::tell_error_code() {
  if (stage_ != Stage::faulted || !fault_axis_ || axes_[*fault_axis_].error_code() == 0) return;
  const cia402::Axis& axis = axes_[*fault_axis_];
  reason_ = fmt::format("{}: fault {}{}: remove the cause, then reset", axis.name(),
                        cia402::error_text(axis.error_code()), fault_what_);
  fault_axis_.reset();
}

void Cia402Profile::refuse(const std::string& reason) {
  enter(Stage::refused);
  reason_ = reason;
}

void Cia402Profile::check_axis(std::size_t i) {
  const cia402::Axis& axis = axes_[i];
  if (!supervised() || stage_ == Stage::faulted || stage_ == Stage::clearing) return;
  if (axis.in_fault()) {
    fault_of_axis(i, "");
  } else if (axis.mode().value_or(cia402::kProfileVelocity) != cia402::kProfileVelocity) {
    fault(fmt::format("{}: mode of operation is {}, not 3 (profile velocity): another tool changed "
                      "it?",
                      axis.name(), *axis.mode()),
          true);
  } else if (stage_ == Stage::enabled && axis.state() != DriveState::operation_enabled) {
    fault(fmt::format("{}: went from OperationEnabled to {} unasked: check its main supply, STO "
                      "and enable inputs",
                      axis.name(), canopen::to_string(axis.state())),
          false);
  } else if (stage_ == Stage::standby && powered(axis.confirmed_state())) {
    fault(fmt::format("{}: is in {} unasked: who switched it on?", axis.name(),
                      canopen::to_string(axis.state())),
          false);
  }
}

void Cia402Profile::watch(Instant now) {
  if (supervised()) {
    for (Node& node : nodes_) {
      if (now - node.heartbeat_stamp < heartbeat_timeout()) continue;
      node.state.reset();
      fault(fmt::format("{}: no heartbeat for {} ms: check its supply and the CAN plug", node.name,
                        config_.drive_heartbeat_timeout_ms),
            true);
    }
  }
  if (stage_ == Stage::enabling || stage_ == Stage::enabled) {
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      if (!axes_[i].fresh(now)) fault(feedback_text(i), false, Cause::feedback);
    }
  }
}

void Cia402Profile::advance(Instant now, std::vector<CanFrame>& nmt,
                            std::vector<CanFrame>& service) {
  switch (stage_) {
    case Stage::listening:
      listen(now);
      break;
    case Stage::securing:
      secure(now, service);
      break;
    case Stage::configuring:
      configure(now, service);
      break;
    case Stage::beating:
      if (beats_ >= 2) start_nodes(now, nmt);
      break;
    case Stage::activating:
      activate(now, nmt);
      break;
    case Stage::settling:
      settle(now);
      break;
    case Stage::enabling:
      climb(now);
      break;
    case Stage::stopping:
      brake(now);
      break;
    case Stage::clearing:
      clear(now);
      break;
    case Stage::idle:
    case Stage::standby:
    case Stage::enabled:
    case Stage::faulted:
    case Stage::refused:
      break;
  }
}

// ---------------------------------------------------------------------------- requests

void Cia402Profile::enable() {
  if (stage_ != Stage::standby) return;
  enter(Stage::enabling);
  climbed_ = {-1, -1};
}

void Cia402Profile::stop(StopKind kind) {
  if (stage_ != Stage::enabling && stage_ != Stage::enabled) return;
  enter(Stage::stopping);
  stop_kind_ = kind;
  braking_ = true;
}

void Cia402Profile::reset_fault() {
  intruders_.clear();
  if (stage_ == Stage::refused || (stage_ == Stage::faulted && needs_restart_)) {
    restart();
  } else if (stage_ == Stage::faulted) {
    enter(Stage::clearing);
    reset_edge_ = false;
  }
}

// ---------------------------------------------------------------------------- moving and stopping

void Cia402Profile::climb(Instant now) {
  bool all_enabled = true;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const cia402::Axis& axis = axes_[i];
    const int reached = height(axis.confirmed_state());
    if (in_stage(now) == Duration{0} || reached > climbed_[i]) {
      climbed_[i] = std::max(climbed_[i], reached);
      climbed_at_[i] = now;
    }
    if (reached == kTop) continue;
    all_enabled = false;
    const bool dropped = climbed_[i] == kTop;
    if (dropped || now - climbed_at_[i] >= step_timeout()) {
      fault(fmt::format("{}: {} {} after controlword 0x{:04X}{}: check its main supply, STO and "
                        "enable inputs",
                        axis.name(), dropped ? "fell back to" : "is still in",
                        canopen::to_string(axis.state()), axis.controlword(),
                        dropped ? "" : fmt::format(" for {} ms", config_.step_timeout_ms)),
            false);
      return;
    }
  }
  if (all_enabled) {
    command_ = {};  // what was said before does not count
    enter(Stage::enabled);
  }
}

void Cia402Profile::brake(Instant now) {
  if (braking_) {
    const bool first = in_stage(now) == Duration{0};
    const bool at_once = first && stop_kind_ == StopKind::disable;
    // A quick stop is sent at least once.
    bool still = at_once || (!first && now >= standstill_from_);
    for (const cia402::Axis& axis : axes_) {
      still = still && (at_once ? axis.standing(now) : axis.confirmed_standing(now));
    }
    if (still) {
      braking_ = false;
      stage_since_ = now;
      reason_.clear();
    } else if (in_stage(now) >= kStopTimeout) {
      reason_ = overdue_stop(now);
    }
    return;
  }
  if (axes_[0].confirmed_off() && axes_[1].confirmed_off()) {
    enter(Stage::standby);
    released_ = {true, true};
    return;
  }
  if (in_stage(now) < step_timeout()) return;
  for (const cia402::Axis& axis : axes_) {
    if (axis.confirmed_off()) continue;
    fault(fmt::format("{}: is still in {} {} ms after it was told to switch its power stage off: "
                      "switch off its supply",
                      axis.name(), canopen::to_string(axis.state()), config_.step_timeout_ms),
          false);
  }
}

std::string Cia402Profile::overdue_stop(Instant now) const {
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if (axes_[i].standing(now)) continue;
    if (!axes_[i].fresh(now)) return feedback_text(i) + "; stop stays commanded";
    return fmt::format(
        "{}: its wheel still turns {:g} s after the quick stop: check brake and "
        "load; stop stays commanded",
        axes_[i].name(), to_seconds(kStopTimeout));
  }
  return "";
}

void Cia402Profile::clear(Instant now) {
  std::optional<std::size_t> faulty;
  bool ready = true;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if (!axes_[i].in_fault()) continue;
    faulty = faulty.value_or(i);
    ready = ready && axes_[i].confirmed_state() == DriveState::fault &&
            (axes_[i].controlword() & canopen::kControlFaultReset) == 0;
  }
  if (!faulty) {
    for (cia402::Axis& axis : axes_) axis.on_emergency(canopen::kEmcyReset);
    enter(Stage::settling);
  } else if (!reset_edge_ && ready) {
    reset_edge_ = true;
    stage_since_ = now;
  } else if (in_stage(now) >= step_timeout()) {
    fault_of_axis(*faulty, " cannot be reset");
  }
}

std::uint16_t Cia402Profile::wanted_controlword(std::size_t i, Instant now) {
  switch (stage_) {
    case Stage::enabling:
    case Stage::enabled:
      return axes_[i].enabling_controlword();
    case Stage::stopping:
      return braking_ ? canopen::kControlQuickStop : canopen::kControlDisableVoltage;
    case Stage::clearing:
      if (!axes_[i].in_fault()) break;
      return reset_edge_ ? canopen::kControlFaultReset : canopen::kControlDisableVoltage;
    default:
      break;
  }
  return stop_controlword(i, now);
}

std::uint16_t Cia402Profile::stop_controlword(std::size_t i, Instant now) {
  const cia402::Axis& axis = axes_[i];
  if (!released_[i] && is_stop(axis.controlword())) {
    released_[i] = axis.confirmed_off() || axis.confirmed_state() == DriveState::not_ready ||
                   axis.confirmed_state() == DriveState::fault ||
                   (axis.confirmed_standing(now) && now >= standstill_from_);
  }
  return released_[i] ? canopen::kControlDisableVoltage : canopen::kControlQuickStop;
}

// ---------------------------------------------------------------------------- texts

bool Cia402Profile::all_fresh(Instant now) const {
  return axes_[0].fresh(now) && axes_[1].fresh(now);
}

std::string Cia402Profile::feedback_text(std::size_t i) const {
  std::string ids;
  for (const cia402::PdoMap::Pdo& pdo : pdos_.tpdos()) {
    if (std::ranges::none_of(pdo.fields, [i](const auto& field) { return field.axis == i; })) {
      continue;
    }
    ids += fmt::format("{}0x{:03X}", ids.empty() ? "" : ", ", pdo.id);
  }
  return fmt::format("{}: feedback older than {} ms (TPDOs {}): check its supply and the CAN plug",
                     axes_[i].name(), config_.feedback_timeout_ms, ids);
}

DrivePhase Cia402Profile::phase() const {
  switch (stage_) {
    case Stage::idle:
    case Stage::listening:
    case Stage::securing:
    case Stage::configuring:
    case Stage::beating:
    case Stage::activating:
    case Stage::settling:
    case Stage::clearing:
      break;
    case Stage::standby:
      return DrivePhase::standby;
    case Stage::enabling:
      return DrivePhase::enabling;
    case Stage::enabled:
      return DrivePhase::enabled;
    case Stage::stopping:
      return DrivePhase::stopping;
    case Stage::faulted:
      return DrivePhase::faulted;
    case Stage::refused:
      return DrivePhase::refused;
  }
  return DrivePhase::starting;
}

}  // namespace tether
