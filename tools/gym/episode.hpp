#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/time.hpp"
#include "common/scenario/scenario.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/network_estimate.hpp"
#include "controller/node/controller_node.hpp"
#include "sim/node/metrics.hpp"
#include "sim/node/sim_node.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/output_folder.hpp"

namespace tether {

/// Kind of an episode's action.
enum class ActionKind : std::uint8_t {
  twist,  ///< [v_mps, omega_radps]: in the place of a law that sends twists
  plan,   ///< controller.horizon_s / controller.plan_step_ms twists: in the place of one that plans
  tau,    ///< [tau_s, send]: the scenario's law decides with this look-ahead
  send,   ///< [send]: the scenario's law decides; from 0.5 on its decision goes out
};

/// Throws UsageError with the allowed names.
ActionKind action_kind(const std::string& name);

/// One number of an action or an observation, and what it may be.
struct NumberSpace {
  std::string name;
  double low;
  double high;
  bool operator==(const NumberSpace&) const = default;
};

/// The numbers of an action, a plan's twists one after another. Twists are within
/// controller.v.limit and controller.omega.limit, look-aheads in [0, 60] s.
std::vector<NumberSpace> action_space(const Scenario& scenario, ActionKind kind);

/// Throws UsageError for a scenario with which there are no such actions: of several vehicles, with
/// a law that does something else, or with keys that then do nothing.
void check_actions(const Scenario& scenario, ActionKind kind);

/// Throws UsageError that names the number that is not finite or not within its space.
void check_action(std::span<const double> action, std::span<const NumberSpace> space);

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

/// Settings of an episode, in addition to its scenario.
struct EpisodeSettings {
  ActionKind action = ActionKind::twist;
  /// Look-ahead times: the path's point then is observed, in the vehicle's frame [s].
  std::vector<double> preview_s;
};

/// The numbers of an observation: only what the controller can know at that time.
///
///   ahead_m, left_m, heading_rad  of the path's point now, in the frame of the newest pose
///   path_v_mps, path_omega_radps  the path's own twist now
///   sent_v_mps, sent_omega_radps  of the last command, or of the last plan's first twist
///   sent_age_s                    since then; before the first, since t = 0
///   pose_age_s                    of the newest pose by its stamp: the age of information
///   pose_silence_s                since it arrived
///   pose_reception                of the last 20 numbered poses, the share that arrived
///   acknowledged_age_s            with plans: since the newest plan that a pose named was decided
///   ahead_m@τ, left_m@τ           for each τ of preview_s, the path's point at now + τ
///
/// Before the first pose the vehicle is taken to stand at its start since t = 0. Throws UsageError
/// for negative or infinite previews.
std::vector<NumberSpace> observation_space(const EpisodeSettings& settings);

/// One run of a scenario's closed loop whose decisions are asked for outside: the very loop of
/// `tether run`, which stops where its law would decide, and goes on at the same instant with the
/// caller's decision. So the same decisions give the same run, bit for bit.
///
/// Decisions are due at each pose or tick, as controller.trigger says, from t = 0 on and once there
/// is a pose; with plans also before. What ControllerNode does without its law, it does without
/// asking: zero twists before the first pose, stops after a pose time-out.
class Episode {
 public:
  /// Runs to the first decision. `log`: a file for all messages, as run.lcmlog; none if empty.
  /// Throws UsageError for what check_actions() refuses.
  Episode(const Scenario& scenario, const EpisodeSettings& settings, const std::string& log = "");

  /// The run has come to its end: no decision is due, and results are final.
  bool is_over() const { return over_; }
  /// Decides, and runs to the next decision or to the end. `action` must be within action_space();
  /// not after the end, but for a run without any decision, which is over when it begins.
  void step(std::span<const double> action);

  /// −∫ ‖p*(t) − p(t)‖ dt over what the last step added to the run's error integral [m·s]. The
  /// simulator adds where it moves the vehicle: by the next pose or truth, always by the end. All
  /// rewards of a run sum up to −ε times its duration.
  double reward() const { return reward_; }
  void observe(std::span<double> out);

  Instant now() { return loop_.loop().now(); }
  /// The newest pose; before the first, the vehicle's nominal start.
  SeenPose pose();
  const Metrics& metrics() { return loop_.sim().metrics(); }

 private:
  void go_on();
  double unrewarded() { return metrics().error_integral_m_s() - rewarded_; }

  EpisodeSettings settings_;
  LawContext context_;
  GivenLaw* given_ = nullptr;  ///< the controller's, of actions that take a law's place
  ClosedLoop loop_;
  Instant end_;
  std::unique_ptr<EventLogWriter> log_;
  ReceptionEstimate reception_{20};
  std::int64_t newest_seq_ = -1;
  std::int64_t undecodable_ = 0;
  bool due_ = false;
  bool over_ = false;
  double rewarded_ = 0.0;  ///< rewarded part of the error integral
  double reward_ = 0.0;
};

}  // namespace tether
