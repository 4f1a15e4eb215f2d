#pragma once

#include <cstdint>
#include <optional>

#include "common/base/time.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"

namespace tether {

/// Which decisions are sent with controller.send = "changed" (send-on-delta: Miskowicz, Sensors 6,
/// 2006). One is sent if it is another one than the last that was:
/// - a twist whose speed is off by more than controller.send_delta_mps, or whose yaw rate by more
///   than controller.send_delta_radps;
/// - a plan off by as much from the one sent, in the mean of any of its steps that both have;
/// - a command or plan to stand still, where the last one was not;
/// and also if
/// - it is the stop of a pose time-out;
/// - otherwise two that were sent would be further apart than controller.send_max_age_s; with
///   trigger = "event", where the time of the next decision is not known, the first one that is
///   so late;
/// - a pose from after the beginning of the last plan sent names another plan: it was lost, or
///   refused. Nothing tells of a twist that was lost but the age limit.
class CommandSending {
 public:
  explicit CommandSending(const ControllerSettings& settings);

  /// Whether the decision of `now`, which goes up, is to be sent; then it counts as sent. `newest`:
  /// the newest pose, or null.
  bool is_due(Instant now, const LawOutput& decision, bool stopped, const SeenPose* newest);

 private:
  bool differs(const Twist& a, const Twist& b) const;
  bool differs(const LawOutput& decision) const;
  bool differs(const Plan& plan, const Plan& sent) const;
  /// Whether the plan that was sent last is not the one in force.
  bool is_missed(const SeenPose* newest) const;

  double delta_mps_, delta_radps_;
  Duration max_age_, period_{};
  std::optional<LawOutput> last_;
  Instant last_at_{};
};

}  // namespace tether
