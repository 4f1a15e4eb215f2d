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
#include "tools/gym/action.hpp"
#include "tools/gym/given_law.hpp"
#include "tools/loop/closed_loop.hpp"
#include "tools/runs/output_folder.hpp"

namespace tether {

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
