#include "can_bridge/cia402/node_startup.hpp"

#include <fmt/format.h>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/read_back.hpp"

namespace tether::cia402 {
namespace {

constexpr int kMaxResets = 2;
constexpr int kMaxBoots = 3;
constexpr std::int64_t kDriveProfile = 402;

std::string abort_advice(std::uint32_t code) {
  switch (static_cast<canopen::Abort>(code)) {
    case canopen::Abort::no_object:
    case canopen::Abort::no_subindex:
      return "choose the drivetrain file of this drive";
    case canopen::Abort::device_state:
      return "switch the drive off and on again";
    case canopen::Abort::wrong_length:
    case canopen::Abort::invalid_value:
    case canopen::Abort::cannot_map:
    case canopen::Abort::pdo_too_long:
      return "correct size and value in the drivetrain file, see the drive's manual";
    default:
      return "see the drive's manual";
  }
}

}  // namespace

NodeStartup::NodeStartup(const Cia402Config& config, std::uint8_t node)
    : name_(node_name(config, node)),
      node_(node),
      boot_timeout_(std::chrono::milliseconds(config.boot_timeout_ms)),
      step_timeout_(std::chrono::milliseconds(config.step_timeout_ms)),
      sdo_timeout_(std::chrono::milliseconds(config.sdo_timeout_ms)),
      sdo_tries_(config.sdo_retries + 1),
      steps_(startup_steps(config, node)),
      sdo_(node, sdo_timeout_, config.sdo_retries) {}

void NodeStartup::begin() {
  state_ = State::reset;
  resets_ = 0;
  boots_ = 0;
  sdo_.cancel();
  refusal_.clear();
  notes_.clear();
}

void NodeStartup::refuse(const std::string& why) {
  state_ = State::refused;
  refusal_ = fmt::format("{}: {}", name_, why);
}

void NodeStartup::on_boot_up() {
  const bool expected = state_ == State::booting || wants_reset_again();
  if (!expected && state_ != State::configuring && state_ != State::done) return;
  if (++boots_ > kMaxBoots) {
    refuse(fmt::format("rebooted {} times during start-up: check its supply voltage", kMaxBoots));
    return;
  }
  begin_steps();
}

void NodeStartup::begin_steps() {
  state_ = State::configuring;
  step_ = 0;
  watchdogs_set_ = 0;
  watchdog_failures_.clear();
  notes_.clear();
  confirmed_.clear();
  shows_mode_late_ = false;
  answers_until_.reset();
  sdo_.cancel();
  begin_step();
}

void NodeStartup::begin_step() {
  const SdoStep& step = steps_[step_];
  reading_ = !step.write.has_value();
  reading_until_.reset();
  if (reading_) {
    sdo_.read(step.read_back);
  } else {
    const bool kept = same_object(kept_.read_back, step.object);
    sdo_.write(step.object, *step.write | (kept ? kept_.expected : 0));
  }
}

void NodeStartup::next_step() {
  if (++step_ < steps_.size()) {
    begin_step();
  } else {
    finish();
  }
}

void NodeStartup::finish() {
  if (watchdogs_set_ > 0) {
    state_ = State::done;
    return;
  }
  refuse(
      fmt::format("no drive-side watchdog is set ({}): its wheel would turn on if this computer "
                  "or the cable failed; name the drive's own watchdog in the drivetrain file",
                  watchdog_failures_.empty() ? "none configured" : watchdog_failures_));
}

void NodeStartup::tick(Instant now, std::vector<CanFrame>& out, bool may_reset_again) {
  if (state_ == State::reset && (resets_ == 0 || may_reset_again)) {
    out.push_back(canopen::nmt_frame(canopen::NmtCommand::reset_node, node_));
    ++resets_;
    deadline_ = now + boot_time();
    state_ = State::booting;
  }
  if (state_ == State::booting && now >= deadline_) {
    if (resets_ < kMaxResets) {
      state_ = State::reset;
    } else {
      refuse(
          fmt::format("no boot-up message within {:g} s: is it powered, is the bit rate right, "
                      "is its node id {}? If it boots more slowly, raise drives.boot_timeout_ms",
                      to_seconds(boot_time()), node_));
    }
  }
  if (state_ == State::configuring && !answers_until_) answers_until_ = now + boot_time();
  // First takes what has arrived, then looks at timeouts, so that neither costs an extra cycle.
  if (const auto result = sdo_.take_result()) on_result(*result, now);
  sdo_.tick(now, out);
  if (const auto result = sdo_.take_result()) on_result(*result, now);
}

void NodeStartup::on_result(const SdoResult& result, Instant now) {
  const SdoStep& step = steps_[step_];
  const ObjectRef& object = reading_ ? step.read_back : step.object;
  const std::string name = object_text(object, step.meaning);
  switch (result.outcome) {
    case SdoResult::Outcome::no_answer:
      if (step_ == 0 && now < *answers_until_) {  // it has booted and is not ready yet
        sdo_.read(step.read_back);
        break;
      }
      refuse(fmt::format(
          "no answer to {} of {} in {} tries of {:g} ms: check the CAN plug and "
          "termination, and that no other device has node id {}; if it answers more "
          "slowly, raise drives.{}",
          reading_ ? "reading" : "writing", name, sdo_tries_, to_milliseconds(sdo_timeout_), node_,
          step_ == 0 ? "boot_timeout_ms" : "sdo_timeout_ms"));
      break;
    case SdoResult::Outcome::segmented:
      refuse(
          fmt::format("answers {} with a segmented transfer, that is with more than 4 bytes: "
                      "choose the drivetrain file of this drive",
                      name));
      break;
    case SdoResult::Outcome::aborted:
      on_failure(step,
                 fmt::format("{} {} aborted: {}", reading_ ? "reading" : "writing", name,
                             canopen::abort_text(result.abort_code)),
                 abort_advice(result.abort_code));
      break;
    case SdoResult::Outcome::done:
      if (reading_) {
        on_value(step, result.value, now);
      } else if (step.check == SdoStep::Check::none) {
        next_step();
      } else {
        reading_ = true;
        sdo_.read(step.read_back);
      }
      break;
  }
}

void NodeStartup::on_value(const SdoStep& step, std::int64_t value, Instant now) {
  if (step.check == SdoStep::Check::drive_profile) {
    const std::string name = object_text(step.read_back, step.meaning);
    const std::int64_t profile = value & 0xFFFF;
    if (profile == kDriveProfile || profile == 0) {
      next_step();
    } else {
      refuse(
          fmt::format("{} says device profile {}, not {} (drives): another device has node id "
                      "{}",
                      name, profile, kDriveProfile, node_));
    }
    return;
  }
  if (step.check == SdoStep::Check::keep) {
    kept_ = step;
    kept_.expected = raw(step.read_back, value) & step.mask;
    next_step();
    return;
  }
  if (is_as_expected(step, value)) {
    // The lower half is the timeout, in heartbeat consumers, too.
    if (step.need == SdoStep::Need::watchdog && (value & 0xFFFF) != 0) ++watchdogs_set_;
    if (step.check == SdoStep::Check::equal) confirmed_.push_back(step);
    next_step();
    return;
  }
  if (step.check == SdoStep::Check::eventually_equal) {
    if (!reading_until_) reading_until_ = now + step_timeout_;
    if (now < *reading_until_) {
      sdo_.read(step.read_back);
      return;
    }
  }
  if (step.need == SdoStep::Need::later && value == 0) {
    shows_mode_late_ = true;
    next_step();
    return;
  }
  on_failure(step, deviation_text(step, value),
             std::string("correct the drivetrain file to what the drive allows, see its manual") +
                 (step.check == SdoStep::Check::eventually_equal
                      ? "; a drive that shows its mode only when enabled needs mode_display in a "
                        "TPDO"
                      : ""));
}

void NodeStartup::on_failure(const SdoStep& step, const std::string& what,
                             const std::string& advice) {
  switch (step.need) {
    case SdoStep::Need::required:
    case SdoStep::Need::later:
      refuse(fmt::format("{}: {}", what, advice));
      return;
    case SdoStep::Need::optional:
      notes_.push_back(fmt::format("{}: {}", name_, what));
      break;
    case SdoStep::Need::watchdog:
      if (!watchdog_failures_.empty()) watchdog_failures_ += "; ";
      watchdog_failures_ += what;
      break;
  }
  next_step();
}

std::string NodeStartup::progress() const {
  switch (state_) {
    case State::reset:
    case State::booting:
      return fmt::format("{}: waiting for its boot-up message", name_);
    case State::configuring:
      if (step_ == 0) return fmt::format("{}: waiting for its first SDO answer", name_);
      return fmt::format("{}: step {} of {}: {}{}", name_, step_ + 1, steps_.size(),
                         object_text(steps_[step_].object, steps_[step_].meaning),
                         sdo_.tries() > 1 ? ", waiting for its SDO answer" : "");
    case State::done:
      return fmt::format("{}: configured", name_);
    case State::idle:
    case State::refused:
      break;
  }
  return refusal_;
}

}  // namespace tether::cia402
