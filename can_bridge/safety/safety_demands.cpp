#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/safety/safety_core.hpp"
#include "common/vehicle/diff_drive.hpp"

// Demands of the vehicle's safety inputs on the safety core.

namespace tether {
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

}  // namespace tether
