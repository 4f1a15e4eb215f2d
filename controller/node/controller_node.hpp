#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <tether/autonomy_state_t.hpp>
#include <tether/odometry_t.hpp>
#include <utility>

#include "common/base/time.hpp"
#include "common/fleet/fleet.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/node/sole_sender.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/world/onboard_settings.hpp"
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

/// The scenario sections that the controller uses.
using ControllerNodeSettings =
    Sections<RunSettings, VehicleSettings, PathSettings, ControllerSettings, ActuatorSettings,
             AutonomySettings, LocaliserSettings, WorldSettings, Surroundings, FleetSettings>;

/// The remote controller: CTRL/POSE and, if the vehicle sends it, CTRL/ODOMETRY in, CTRL/CMD_VEL or
/// CTRL/PLAN (and CTRL/REPORT, CTRL/COUNTERS) out.
///
/// `trigger = event`: one decision per accepted pose. `trigger = timer`: decisions at
/// controller.rate_hz from t = 0 on, or from the start of the run's lead, from the newest pose.
///
/// A decision is a twist, or with a predictive law a plan.
/// - Before the first pose, event sends nothing and timer sends zero twists. During the lead,
///   before t = 0, both send zero twists. Predictive laws plan in both cases if the start is known:
///   the vehicle stands there. Else (localiser.knows_start = false, or the controller begins more
///   than a second after t = 0) they send plans to stop.
/// - When the newest pose is controller.pose_timeout_s old or older (age by its time stamp, so
///   delay counts), or no pose has come for that long since t = 0 or the controller's own start:
///   event sends one zero twist, or a plan to stop; timer one each time; the law starts afresh with
///   the next pose. A pose that arrives too old already is answered by a stop.
///   pose_timeout_s = 0: never (the paper).
/// - With controller.preload, the first plan is on CTRL/PRELOAD at the beginning of the run.
/// - With controller.send = "changed", not all of them go out (CommandSending); reports do.
///
/// With autonomy.enabled, CTRL/AUTONOMY comes in, too, and goes to the law. What goes out then
/// names in its pose_utime the newest report by which the vehicle asks for a remote driver, −1
/// while it does not ask: that is how it knows that a command means its present request
/// (docs/explanation/autonomy.md).
///
/// Poses that are undecodable, non-finite (or beyond ±1e9), duplicated, late or stamped in the
/// future are counted and otherwise ignored; they refresh nothing. So is odometry, which goes to
/// the law and triggers no decision.
class ControllerNode final : public Node {
 public:
  /// `session`: tells the plans of this start from those of any other; nullopt: derived from the
  /// run's seed. `law`: in place of the settings' own.
  ControllerNode(const ControllerNodeSettings& settings, EventLoop& loop, Bus& bus,
                 std::optional<std::int64_t> session = std::nullopt,
                 std::unique_ptr<Law> law = nullptr);

  /// From now on, where the law would be asked for a decision, `ask` is called instead. The callee
  /// then calls decide_by_law(), not later than the next event of the loop: the run is the same as
  /// if `ask` did not exist.
  void ask_before_deciding(std::function<void()> ask) { ask_ = std::move(ask); }
  /// `sends`: whether the decision goes out, if it does by the scenario. It is reported anyway.
  void decide_by_law(bool sends = true);

  Law& law() { return *law_; }
  /// The newest pose, if there is any.
  const SeenPose* newest() const { return newest_ ? &*newest_ : nullptr; }
  /// The last command that was sent, or the first twist of the last plan.
  struct Sent {
    Instant when;
    Twist twist;
  };
  const std::optional<Sent>& last_sent() const { return last_sent_; }

  /// Publishes the final counters. Sends no command: the actuator policy decides what happens to a
  /// vehicle whose controller is gone.
  void finish() override;

 private:
  void on_pose(const SeenPose& seen);
  void on_odometry(const odometry_t& message);
  void on_autonomy(const autonomy_state_t& message);
  void decide();
  void on_possible_timeout();
  bool timed_out(Instant now) const;
  void send(Instant now, const LawOutput& decision, bool stopped, bool sends = true);
  void send_twist(Instant now, const Twist& twist);
  void send_plan(Instant now, const Plan& plan, const std::string& channel);
  std::int64_t pose_utime() const;
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  ChannelNames channels_;
  SoleSender senders_;
  ControllerSettings config_;
  Duration pose_timeout_;
  Instant begun_;     ///< from where the time-out counts until a pose has come
  bool start_known_;  ///< a law may plan from the start of the scenario
  std::int64_t session_;
  std::unique_ptr<Law> law_;
  std::function<void()> ask_;
  StreamGuard guard_;

  StreamGuard odometry_guard_;
  /// With autonomy: the reports, and the newest if it asks.
  struct Reports {
    explicit Reports(Instant earliest) : guard({.earliest = earliest}) {}
    StreamGuard guard;
    Rejected rejected;
    std::int64_t non_finite = 0;
    std::optional<Instant> asked{};
  };
  std::optional<Reports> reports_;

  std::optional<SeenPose> newest_;
  Rejected rejected_;
  std::int64_t non_finite_ = 0;
  bool any_odometry_ = false;
  std::int64_t undecodable_odometry_ = 0;
  std::int64_t non_finite_odometry_ = 0;
  std::optional<CommandSending> sending_;  ///< not set: all decisions are sent
  std::optional<Sent> last_sent_;
  std::int64_t decisions_ = 0;
  std::int64_t sent_ = 0;
  std::int64_t pose_timeouts_ = 0;
  std::int64_t unusable_commands_ = 0;
  CounterReporter counters_;
};

}  // namespace tether
