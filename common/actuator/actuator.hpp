#pragma once

#include <cstdint>
#include <optional>

#include "common/actuator/actuator_policy.hpp"
#include "common/actuator/actuator_settings.hpp"
#include "common/actuator/plan.hpp"
#include "common/actuator/plan_buffer.hpp"
#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/stop_ramp.hpp"

namespace tether {

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
