#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "can_bridge/cia402/axes.hpp"
#include "can_bridge/cia402/axis.hpp"
#include "can_bridge/cia402/stage.hpp"

namespace tether::cia402 {

/// A reason to stop the vehicle and to stay stopped.
struct Fault {
  enum class Cause { feedback, other };

  std::string reason;          ///< for a technician
  bool needs_restart = false;  ///< a drive's configuration may be lost
  Cause cause = Cause::other;
  /// A fault that the drive of this axis has itself: its error code may come later. `what`: more
  /// text for the reason.
  std::optional<std::size_t> axis{};
  const char* what = "";
};

/// The fault that axis `i` reports itself.
Fault fault_of_axis(const Axes& axes, std::size_t i, const char* what = "");

/// Holds the stage `faulted` and the reason for it. The first fault counts; but missing feedback is
/// often only the first sign of what is wrong, and gives way to any other fault.
class FaultLatch {
 public:
  /// Enters `faulted`: each axis has to brake and to stand before its power stage may go off. Does
  /// nothing before start() and when the drives are refused.
  void latch(const Fault& fault, StageClock& stage, Axes& axes);
  /// Puts an error code that came after its fault into the reason.
  void tell_error_code(StageClock& stage, const Axes& axes);
  /// Forgets the fault, for a new start.
  void clear();

  bool needs_restart() const { return needs_restart_; }

 private:
  bool needs_restart_ = false;
  Fault::Cause cause_ = Fault::Cause::other;
  std::optional<std::size_t> axis_;  // whose error code is still missing in the reason
  const char* what_ = "";
};

}  // namespace tether::cia402
