#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "controller/laws/law.hpp"
#include "controller/laws/network_estimate.hpp"

namespace tether {

/// A law whose decisions are given to it, one before each. Its errors are those of the newest pose
/// to the path at the decision, as the tracking law's.
///
/// Plans begin where the plain predictive law's do: the longest delay of the last poses from now,
/// not before t = 0. They are based on any plan and never settle. After a pose time-out it is a
/// plan to stand still.
class GivenLaw final : public Law {
 public:
  GivenLaw(LawContext context, bool plans);

  /// The next decision: v and ω of one twist, or of each of a plan.
  void give(std::span<const double> twists);
  /// When the newest plan was decided that a pose has named; nullopt before.
  std::optional<Instant> acknowledged() const { return acknowledged_; }

  void on_pose(const SeenPose& seen) override;
  LawOutput decide(Instant now, const SeenPose* newest) override;
  LawOutput stop(Instant now) override;
  bool plans_ahead() const override { return plans_; }
  LawErrors errors() const override { return errors_; }
  void list_counters(CounterList& out) const override;

 private:
  LawOutput plan(Instant now, std::vector<Twist> twists);

  LawContext context_;
  bool plans_;
  Duration sensor_latency_;
  DelayEstimate delay_;
  std::vector<Twist> given_;
  std::vector<Instant> decided_;  ///< by the plan's id
  std::optional<Instant> acknowledged_;
  LawErrors errors_;
};

}  // namespace tether
