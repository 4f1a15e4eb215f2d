#pragma once

#include <string>

#include "common/base/time.hpp"
#include "common/world/stopping_field.hpp"
#include "onboard/autonomy/onboard_driver.hpp"

namespace tether::test {

/// Who may drive and how, as rules that are checked at every setpoint, by nothing but what the
/// driver says and does:
///
/// - Each setpoint is of one driver, and while it is not zero that driver may drive: the law only
///   in AUTONOMOUS, not before t = 0; a remote driver only in REMOTE, within remote_timeout of a
///   command of his that names a report of the present request.
/// - No driver: the pace falls at the brakes' rate, or is zero.
/// - v and ω change by no more than the limits from one setpoint to the next.
/// - Between two drivers the setpoint was zero.
/// - Driven remotely it is no faster than remote_speed.
/// - From a protective stop on it goes no farther than its stopping field.
class DrivingRules {
 public:
  DrivingRules(const AutonomySettings& autonomy, const Outline& outline, double step_s);

  /// A setpoint. `last_fit`: when the last command arrived that names the present request.
  void check(Instant now, const OnboardDriver::Output& out, Instant last_fit);
  /// How far the vehicle moved until the next one.
  void moved(double way_m);
  /// Reports the finding of another rule.
  void broken(const std::string& what);

  /// The first rule that was broken; "" if none was.
  const std::string& broken() const { return broken_; }

 private:
  void check_change(const Twist& setpoint);
  void check_driverless(const Twist& setpoint);
  void check_driver(Instant now, const OnboardDriver::Output& out, Instant last_fit);

  AutonomySettings autonomy_;
  StoppingField stopping_;
  Outline outline_;
  double step_s_;

  Twist before_;
  DriveState state_ = DriveState::autonomous;
  Driver last_driver_ = Driver::none;
  double stop_way_m_ = 0.0, may_go_m_ = 0.0;
  std::string broken_;
};

}  // namespace tether::test
