#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/actuator_policy.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/plan.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/stop_ramp.hpp"

namespace tether {

/// Fate of a plan that reached the vehicle.
enum class PlanFate {
  accepted,
  unusable,  ///< a twist that is not finite or absurd (is_usable), none at all, a name below 0,
             ///< or based on a range that runs backwards or has no ids
  bad_step,  ///< time stands still or runs backwards: step ≤ 0
  too_long,  ///< more than kMaxTwists, or longer than kMaxHorizon
  other_session,  ///< its session is superseded, or its base plan's session is not followed
  out_of_order,   ///< refused by StreamGuard, which counts why
  repeated,       ///< accepted before, and still followed or waiting
  too_early,      ///< starts later than the source may plan ahead
  expired,        ///< over before it arrived
  inconsistent,   ///< based on another plan than the one that it would take over from
  overfull,       ///< kMaxWaiting wait already
  before_stop,    ///< decided before the last stop()
  // Only where plans need poses (need_poses):
  without_pose,  ///< predicted from no pose, or from one of the future
  older_pose,    ///< predicted from an older pose than the newest accepted plan
  blind,         ///< stamped, or predicted from a pose that was measured, too long ago
};
inline constexpr std::size_t kPlanFates = 15;

/// Executes plans by time: the schedule of a vehicle. Pure; `now` must not go backwards.
///
/// The schedule is a row of plans, each with the time at which it takes over: its start, or its
/// arrival if it came later (it begins in its middle then). An accepted plan throws away all that
/// would take over at its own time or later, and leaves what comes before: plans whose start lies
/// ahead wait while the old one goes on. A plan stays in force until another takes over, also when
/// its horizon is over: the ramp to a stop (ramp_to_stop) and the standstill after it are the end
/// of the plan. Before the first plan takes over there is none.
///
/// Consistency. A plan is based on the plan that the vehicle was predicted to follow until the
/// start. It is refused unless that plan is the one from which it takes over, at max(start, now),
/// or the one that took over at that very instant. ANY fits always; NONE fits where there is no
/// plan or one of another session. A plan may be based on a range of ids: on any of them that has
/// settled by then and is not over, for all these predict the vehicle in the same place
/// (PredictiveLaw).
///
/// newest() is what poses report: the last of the schedule, even if it still waits. The sender of
/// that plan knows what it is based on, and so the whole motion from the pose on; and plans based
/// on it are accepted. The first plan of the schedule stays, so there is always something that a
/// plan can be based on, whatever was lost: on newest(), which only a new plan changes, on NONE
/// from a new session or before the first, or on ANY.
///
/// Sessions. The first plan of another session takes over if it is based on NONE or ANY; the
/// session before is then superseded, and its plans are refused. Only when the new session was not
/// heard for kSessionSilence may an old one come back, so that a damaged packet does not shut out a
/// controller for ever. The last kSessions are remembered. While hold_session() is on, no session
/// takes over.
class PlanBuffer {
 public:
  static constexpr std::size_t kMaxTwists = 4000;
  static constexpr Duration kMaxHorizon = std::chrono::seconds{600};
  static constexpr Duration kMaxAhead = std::chrono::seconds{10};      ///< start, from the network
  static constexpr Duration kMaxPreload = std::chrono::seconds{3600};  ///< start, of a preload
  static constexpr std::size_t kMaxWaiting = 32;
  static constexpr Duration kSessionSilence = std::chrono::seconds{10};
  static constexpr std::size_t kSessions = 64;

  PlanBuffer(const StopLimits& limits, const StreamGuard::Config& guard);

  /// From now on, plans from the network are refused unless they were predicted from a pose, not
  /// older than that of the plan before, and both pose and stamp are younger than `max_age`.
  void need_poses(Duration max_age) { max_age_ = max_age; }

  /// Whether one that says to stand still needs none of that: of a vehicle that drives.
  void accept_any_stop(bool on) { any_stop_ = on; }

  /// Whether plans of other sessions than the present one are refused, those of the first too.
  void hold_session(bool on) { session_held_ = on; }
  /// The session that is followed; none before the first plan.
  std::optional<std::int64_t> session() const { return session_; }

  /// A plan that arrives at `now`.
  PlanFate offer(Instant now, PlanSource source, Plan plan);

  /// Forgets the schedule; sessions stay.
  void clear() { schedule_.clear(); }
  /// The same, for good: plans that were decided (stamped) before `now` are refused from now on.
  void stop(Instant now) {
    clear();
    stopped_ = now;
    newest_pose_ = Instant::min();
    seen_.reset();
  }

  /// The twist to realise; none before a plan takes over.
  std::optional<Twist> in_force(Instant now) const;

  /// in_force() says the same from `now` on until before then: a later instant, or `now` where it
  /// changes all the time.
  Instant unchanged_until(Instant now) const;

  /// The accepted plan that takes over last; none before the first.
  PlanName newest() const;

  /// Where plans need poses: when a controller last knew where the vehicle is. It is the earliest
  /// of pose, stamp and arrival of the newest plan from the network with a pose that was accepted;
  /// none before the first and after stop().
  std::optional<Instant> seen() const { return seen_; }

  /// When the last twist of the plan in force ends; none if no plan is in force.
  std::optional<Instant> end(Instant now) const;
  bool empty() const { return schedule_.empty(); }

  std::int64_t count(PlanFate fate) const { return counts_[static_cast<std::size_t>(fate)]; }

  /// Appends "plan.received", "plan.accepted", one for each reason of refusal, whose sum they are;
  /// then "plan.missed" and "plan.sessions" (that took over).
  void list(CounterList& out) const;

 private:
  struct Entry {
    Instant from;  ///< takes over
    Plan plan;
  };

  PlanFate judge(Instant now, PlanSource source, const Plan& plan);
  PlanFate judge_pose(Instant now, const Plan& plan) const;
  bool may_take_over(Instant now, const Plan& plan) const;
  bool is_consistent(Instant now, const Plan& plan) const;
  const Entry* last_until(Instant t, bool inclusive) const;
  void insert(Instant now, Plan plan);
  void begin_session(std::int64_t session);
  StreamGuard& guard(PlanSource source) { return guards_[static_cast<std::size_t>(source)]; }

  StopLimits limits_;
  std::array<StreamGuard, 2> guards_;  // by PlanSource: each numbers its own packets
  std::deque<Entry> schedule_;         // by time of taking over
  Instant stopped_ = Instant::min();
  Duration max_ahead_;               // limit of a stamp's lead
  std::optional<Duration> max_age_;  // age of stamp and pose; none: poses are not needed
  std::optional<Instant> seen_;
  Instant newest_pose_ = Instant::min();
  bool session_held_ = false;
  bool any_stop_ = false;
  std::optional<std::int64_t> session_;
  Instant session_heard_{};
  std::deque<std::int64_t> superseded_;
  std::int64_t sessions_ = 0;
  std::array<std::int64_t, kPlanFates> counts_{};
};

/// The vehicle's reaction to commands (docs/reference/actuator.md).
/// - `hold` (the paper): the last command stays in force until the next one.
/// - `zero`: a command stays in force for timeout_s after its arrival, then the twist is zero.
/// - `ramp`: the same, but then the twist ramps to zero (ramp_to_stop).
/// - `decay`: the same, but then v and ω fall exponentially with decay_s, both by one factor, to
///   zero when they are below 1 mm/s and 1 mrad/s.
/// - `horizon`: plans, executed by time (PlanBuffer). A twist ends them all, at once, and counts as
///   by `ramp` until a plan takes over: the newest word.
/// Before the first command, or before the first plan takes over, the twist is zero.
///
/// Twists that come out may jump; rims do not: plants and the CAN bridge limit their acceleration.
/// Pure: `now` must not go backwards. Commands are finite and in order (StreamGuard), plans need
/// not be. With policies that take no plans these are counted as "plan.unasked" and ignored.
class Actuator {
 public:
  /// `guard`: for the stamps of plans.
  Actuator(const ActuatorSettings& config, const VehicleConfig& vehicle,
           const StreamGuard::Config& guard);

  void on_command(Instant now, const Twist& command);
  /// Whether it was accepted.
  bool on_plan(Instant now, PlanSource source, Plan plan);

  /// The vehicle stops at `now`, regardless of its commands: PlanBuffer::stop().
  void end_plans(Instant now) { plans_.stop(now); }

  /// For a vehicle that a wrong plan could hurt: see PlanBuffer.
  void need_poses(Duration max_age) { plans_.need_poses(max_age); }
  void accept_any_stop(bool on) { plans_.accept_any_stop(on); }
  void hold_session(bool on) { plans_.hold_session(on); }
  std::optional<std::int64_t> session() const { return plans_.session(); }
  std::optional<Instant> seen() const { return plans_.seen(); }

  /// The twist to realise at `now`.
  Twist in_force(Instant now) const;

  /// in_force() says the same from `now` on until before then, if nothing arrives: a later instant,
  /// or `now` where it changes all the time.
  Instant unchanged_until(Instant now) const;

  /// Plan in force, as poses report it: PlanBuffer::newest(), none after a twist.
  PlanName plan() const { return plans_.newest(); }

  /// For those who watch whether commands are fresh: how long ago the plan in force ended, 0 if it
  /// did not, and before the first of all takes over; none where twists count.
  std::optional<Duration> plan_age(Instant now) const;

  bool takes_plans() const { return policy_->takes_plans; }

  /// Appends plan.…: with `horizon`, and with other policies if there were any.
  void list(CounterList& out) const;

 private:
  Twist command_in_force(Instant now) const;

  Twist command_;
  Instant arrival_ = kStart;
  Duration timeout_;
  const ActuatorPolicy* policy_;  // an element of actuator_policies()
  bool any_command_ = false;
  StopLimits limits_;
  PlanBuffer plans_;
  ActuatorSettings config_;
  std::int64_t unasked_plans_ = 0;
};

}  // namespace tether
