#include "can_bridge/cia402/fault_latch.hpp"

#include <fmt/format.h>

#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {

Fault fault_of_axis(const Axes& axes, std::size_t i, const char* what) {
  return {
      .reason = fmt::format("{}: fault{}, error code not known yet: remove the cause, then reset",
                            axes[i].name(), what),
      .axis = i,
      .what = what};
}

void FaultLatch::latch(const Fault& fault, StageClock& stage, Axes& axes) {
  if (stage.stage() == Stage::idle || stage.stage() == Stage::refused) return;
  needs_restart_ = needs_restart_ || fault.needs_restart || stage.stage() < Stage::settling;
  if (stage.stage() == Stage::faulted) {
    if (cause_ != Fault::Cause::feedback || fault.cause == Fault::Cause::feedback) return;
    stage.tell(fault.reason);
  } else {
    stage.enter(Stage::faulted, fault.reason);
    axes.hold();
  }
  cause_ = fault.cause;
  axis_ = fault.axis;
  what_ = fault.what;
  tell_error_code(stage, axes);
}

void FaultLatch::tell_error_code(StageClock& stage, const Axes& axes) {
  if (stage.stage() != Stage::faulted || !axis_ || axes[*axis_].error_code() == 0) return;
  const Axis& axis = axes[*axis_];
  stage.tell(fmt::format("{}: fault {}{}: remove the cause, then reset", axis.name(),
                         error_text(axis.error_code()), what_));
  axis_.reset();
}

void FaultLatch::clear() {
  needs_restart_ = false;
  axis_.reset();
}

}  // namespace tether::cia402
