#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "controller/laws/controller_settings.hpp"
#include "tools/margin/loss_chain.hpp"
#include "tools/margin/sampled_loop.hpp"

namespace tether {

struct LinkConfig;
struct SensorSettings;

/// Why the theory does not hold for a scenario, each reason with the key that says so; empty if it
/// does. It holds for laws that answer each pose and remember nothing (`tracking`; `pid` without I
/// and D), a vehicle that holds its commands, constant delays, and links whose losses are a Markov
/// chain's from pose to pose; and, without delays, for plans that roll out `tracking`
/// (`predictive`, `predictive_consistent`) and are longer than silences.
std::vector<std::string> margin_obstacles(const Scenario& scenario);
/// Whether the law's plans roll out the tracking law.
bool has_linear_plans(const ControllerSettings& controller);
/// Throws UsageError with all of them if there are any.
void refuse_margin_obstacles(const Scenario& scenario);
/// The same of the channel alone, whatever the law.
void refuse_channel_obstacles(const Scenario& scenario);

/// Whether the sensor's errors are white noise, and nothing else.
bool is_white(const SensorSettings& sensor);

/// The delay that a link has in all states, s; 0 if it has no such.
double only_delay_s(const LinkConfig& link);

/// The loop of a scenario on a straight, at its path's greatest speed between run.settled_from_s
/// and the run's end.
struct StraightLoop {
  /// The scenario has no margin_obstacles(). Throws UsageError if its path rests all the time, or
  /// is faster than controller.v.limit or the wheels; and if plans end within one of 10 000
  /// silences.
  explicit StraightLoop(const Scenario& scenario);

  /// δω = v (k_y y_e + k_theta θ_e).
  SteeringLoop steering;
  LawJacobian law;
  /// By how much the law holds the vehicle behind the point that it aims at, m (`pid`: P·distance
  /// is the path's speed v/P behind the target, which is v τ ahead of the path's point).
  double behind_m = 0.0;
  LoopTiming timing;
  PoseNoise noise;
  double v_mps = 0.0, least_mps = 0.0;
  ChainLink uplink, downlink;
  bool shared = false;       ///< channel.shared_state
  double plan_step_s = 0.0;  ///< step of laws that plan; else 0
  bool plans() const { return plan_step_s > 0.0; }

  /// Period of a law that plans.
  PlannedPeriod planned_period() const;
  /// Plans have no delay, and their own period.
  LoopStep step(const LoopTiming& with) const;
  /// Both links with this much more independent loss each.
  LossChain chain(double more_loss = 0.0) const;
  /// Share of the packets that each link lets through, the mean of both.
  double prr_each_way() const;
  double radius(const LossChain& chain, LoopPart part = LoopPart::all) const;
  /// Growth of the mean square per period if poses take this long in all, the greater of both
  /// parts.
  double radius_with_delay(const LossChain& chain, double delay_s) const;
  /// √E[d²] by the sensor's white noise and the poses' delay; nullopt if unstable.
  std::optional<double> rms_m(const LossChain& chain) const;
};

}  // namespace tether
