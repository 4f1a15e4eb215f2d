#include "tools/margin/straight_loop.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/fit/link_expectation.hpp"
#include "netem/models/kinds.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {
namespace {

ChainLink chain_of(const LinkConfig& link, double period_s) {
  const LinkExpectation expected = expect_link(link, {.interval_s = period_s});
  ChainLink chain;
  chain.prr.clear();
  for (const ExpectedState& state : expected.channel->states()) chain.prr.push_back(state.prr);
  chain.transition = expected.channel->transition();
  chain.steps_by_packets = kind_of(link).moves(link) == ChannelModelKind::Moves::per_packet;
  return chain;
}

ChainLink with_loss(ChainLink link, double loss) {
  for (double& prr : link.prr) prr *= 1.0 - loss;
  return link;
}

double mean_prr(const ChainLink& link) {
  const auto stationary = stationary_distribution(link.transition);
  double sum = 0.0;
  for (std::size_t i = 0; i < link.prr.size(); ++i) sum += (*stationary)[i] * link.prr[i];
  return sum;
}

/// A vehicle that cannot have the path's speed stays behind more and more.
void check_limits(const Scenario& scenario, double v_mps) {
  const auto check = [&](const char* key, double most_mps) {
    if (most_mps >= v_mps) return;
    throw UsageError(
        fmt::format("margin: {} = {:g} must be at least the path's speed, {:.3f} m/s: the vehicle "
                    "cannot follow it",
                    key, most_mps, v_mps));
  };
  check("controller.v.limit", scenario.get<ControllerSettings>().v.limit);
  check("vehicle.max_wheel_speed_mps", scenario.get<VehicleSettings>().max_wheel_speed_mps);
}

}  // namespace

bool has_linear_plans(const ControllerSettings& controller) {
  return controller.law == "predictive" || controller.law == "predictive_consistent";
}

bool is_white(const SensorSettings& s) {
  return s.noise_correlation_s == 0.0 && s.bias_x_m == 0.0 && s.bias_y_m == 0.0 &&
         s.bias_yaw_rad == 0.0 && s.position_drift_mpsqrts == 0.0 && s.yaw_drift_radpsqrts == 0.0 &&
         s.jumps_per_min == 0.0;
}

double only_delay_s(const LinkConfig& link) {
  const auto delay_ms = kind_of(link).only_delay_ms;
  return delay_ms == nullptr ? 0.0 : 1e-3 * delay_ms(link).value_or(0.0);
}

StraightLoop::StraightLoop(const Scenario& scenario) {
  const auto& sensor = scenario.get<SensorSettings>();
  const auto& channel = scenario.get<ChannelSettings>();
  timing = {1.0 / sensor.rate_hz, 1e-3 * sensor.latency_ms + only_delay_s(channel.uplink),
            only_delay_s(channel.downlink)};
  noise = {sensor.position_noise_m, sensor.yaw_noise_rad};
  uplink = chain_of(channel.uplink, timing.period_s);
  downlink = chain_of(channel.downlink, timing.period_s);
  shared = channel.shared_state;
  const auto& run = scenario.get<RunSettings>();
  const auto path = make_path(scenario.get<PathSettings>());
  constexpr int kPoints = 5000;
  const double from_s = std::min(run.settled_from_s, run.duration_s);
  v_mps = least_mps = path->at(from_s).v_mps;
  for (int i = 1; i <= kPoints; ++i) {
    const double v = path->at(from_s + (run.duration_s - from_s) * i / kPoints).v_mps;
    v_mps = std::max(v_mps, v);
    least_mps = std::min(least_mps, v);
  }
  if (!(v_mps > 0.0)) {
    throw UsageError("margin: the path rests from run.settled_from_s on: nothing steers there");
  }
  check_limits(scenario, v_mps);
  const auto& c = scenario.get<ControllerSettings>();
  double k_x = c.tracking.k_x;
  steering = {c.tracking.k_y, c.tracking.k_theta, v_mps};
  if (c.law == "pid") {
    // Towards the target, `distance` ahead: ω = P (y_e + distance·θ_e)/distance.
    const double distance_m = v_mps / c.v.p;
    k_x = c.v.p;
    steering = {c.omega.p / (distance_m * v_mps), c.omega.p / v_mps, v_mps};
    behind_m = distance_m - v_mps * c.tau_s;
  }
  law = tracking_jacobian(k_x, steering.k_y, steering.k_theta, v_mps);
  if (!has_linear_plans(c)) return;
  plan_step_s = to_seconds(c.plan_step());
  const auto silence = chain().silence_periods(1e-4);
  if (silence && *silence * timing.period_s <= c.horizon_s) return;
  throw UsageError(fmt::format(
      "margin: controller.horizon_s = {:g} must be longer than all but one in 10 000 silences, {}",
      c.horizon_s,
      silence ? fmt::format("{:g} s", *silence * timing.period_s) : "which have no end"));
}

PlannedPeriod StraightLoop::planned_period() const {
  const auto steps = static_cast<int>(std::lround(timing.period_s / plan_step_s));
  return {{v_mps, 0.0}, law, plan_step_s, steps};
}

LoopStep StraightLoop::step(const LoopTiming& with) const {
  const PathMotion motion{v_mps, 0.0};
  if (plans()) return planned_step(planned_period(), noise);
  return sampled_step({motion, motion, motion, law}, with, noise);
}

LossChain StraightLoop::chain(double more_loss) const {
  const ChainLink up = with_loss(uplink, more_loss), down = with_loss(downlink, more_loss);
  return shared ? shared_links(up, down.prr) : both_links(up, down);
}

double StraightLoop::prr_each_way() const { return 0.5 * (mean_prr(uplink) + mean_prr(downlink)); }

double StraightLoop::radius(const LossChain& chain, LoopPart part) const {
  if (plans()) return planned_radius(chain, planned_period(), part);
  return mean_square_radius(chain, {part_of(step(timing), part)});
}

double StraightLoop::radius_with_delay(const LossChain& chain, double delay_s) const {
  const LoopStep late = step({timing.period_s, delay_s, 0.0});
  return std::max(mean_square_radius(chain, {part_of(late, LoopPart::across)}),
                  mean_square_radius(chain, {part_of(late, LoopPart::along)}));
}

std::optional<double> StraightLoop::rms_m(const LossChain& chain) const {
  if (std::max(radius(chain, LoopPart::across), radius(chain, LoopPart::along)) >= 1.0) {
    return std::nullopt;
  }
  const auto moments = stationary_moments(chain, {step(timing)});
  if (!moments) return std::nullopt;
  // Without noise, rounding may leave a little below 0.
  const double m2 = square_distance(moments->front(), v_mps * timing.pose_delay_s - behind_m);
  return std::sqrt(std::max(0.0, m2));
}

}  // namespace tether
