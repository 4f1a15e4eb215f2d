#pragma once

#include <cstdint>

#include "common/bus.hpp"
#include "common/channel_names.hpp"
#include "common/counter_reporter.hpp"
#include "common/event_loop.hpp"
#include "common/node.hpp"
#include "common/scenario.hpp"
#include "common/stream_guard.hpp"
#include "controller/pid_law.hpp"

namespace tether {

/// The remote controller: CTRL/POSE in, CTRL/CMD_VEL (and CTRL/REPORT, CTRL/COUNTERS) out.
///
/// `trigger = event`: one command per accepted pose. `trigger = timer`: commands at
/// controller.rate_hz from t = 0 on, from the newest pose.
///
/// Before the first pose: event sends nothing, timer sends zero twists. Before t = 0, in the run's
/// lead: zero twists. When the newest pose is
/// controller.pose_timeout_s old or older (age by its time stamp, so delay counts): event sends one
/// zero twist, timer sends zero twists; the law starts afresh with the next pose. A pose that
/// arrives too old already is answered by a zero twist. pose_timeout_s = 0: never (the paper).
///
/// Poses that are undecodable, non-finite (or beyond ±1e9), duplicated, late or stamped in the
/// future are counted and otherwise ignored; they refresh nothing.
class ControllerNode final : public Node {
 public:
  ControllerNode(const Scenario& scenario, EventLoop& loop, Bus& bus);

  /// Publishes the final counters. Sends no command: the actuator policy decides what happens to a
  /// vehicle whose controller is gone.
  void finish() override;

 private:
  void on_pose(Instant stamp, std::int64_t seq, const Pose2& pose);
  void decide();
  void on_possible_timeout();
  bool timed_out(Instant now) const;
  void send(Instant now, const Twist& twist, bool stopped);
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  ChannelNames channels_;
  Scenario::Controller config_;
  Duration pose_timeout_;
  PidLaw law_;
  StreamGuard guard_;

  bool have_pose_ = false;
  Pose2 pose_;
  Instant pose_stamp_{};
  std::int64_t pose_seq_ = -1;
  std::int64_t undecodable_ = 0;
  std::int64_t non_finite_ = 0;
  std::int64_t commands_ = 0;
  std::int64_t pose_timeouts_ = 0;
  std::int64_t unusable_commands_ = 0;
  CounterReporter counters_;
};

}  // namespace tether
