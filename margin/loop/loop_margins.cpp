#include "margin/loop/loop_margins.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/actuator/actuator_settings.hpp"
#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/onboard/onboard_settings.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "margin/theory/delay_margin.hpp"
#include "margin/theory/sampled_loop.hpp"
#include "netem/channel/settings.hpp"
#include "netem/check/link_expectation.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/kinds.hpp"
#include "netem/stages/kinds.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {
namespace {

using Reasons = std::vector<std::string>;

void add_if(bool condition, Reasons& reasons, const char* why) {
  if (condition) reasons.emplace_back(why);
}

void controller_obstacles(const Scenario& scenario, Reasons& reasons) {
  const auto& c = scenario.get<ControllerSettings>();
  if (c.law != "tracking") {
    reasons.push_back(fmt::format(
        "controller.law = \"{}\": must be \"tracking\"; others plan, predict, or remember", c.law));
  }
  add_if(
      c.trigger != ControllerSettings::Trigger::event, reasons,
      "controller.trigger = \"timer\": must be \"event\"; else commands repeat poses of any age");
  add_if(c.send != ControllerSettings::Send::always, reasons,
         "controller.send = \"changed\": must be \"always\"; what is sent depends on the errors");
  add_if(c.estimator != ControllerSettings::Estimator::none, reasons,
         "controller.estimator = \"ekf\": must be \"none\"; a filter has states of its own");
  add_if(c.is_external(), reasons,
         "controller.external: must be false; another program's law is unknown");
  add_if(c.pose_timeout_s > 0.0, reasons,
         "controller.pose_timeout_s: must be 0; a stop in silences is not linear");
  add_if(scenario.get<ActuatorSettings>().policy != "hold", reasons,
         "actuator.policy: must be \"hold\"; other policies act on the time without commands");
}

void vehicle_obstacles(const Scenario& scenario, Reasons& reasons) {
  const auto& v = scenario.get<VehicleSettings>();
  add_if(v.drivetrain != VehicleSettings::Drivetrain::direct, reasons,
         "vehicle.drivetrain = \"can\": must be \"direct\"; the bridge limits and stops");
  add_if(v.radius_error != 0.0 || v.track_error != 0.0 || v.actuator_lag_ms != 0.0, reasons,
         "vehicle.radius_error, .track_error, .actuator_lag_ms: must be 0; they are not modelled");
  add_if(scenario.get<AutonomySettings>().enabled, reasons,
         "autonomy.enabled: must be false; the vehicle then drives by itself");
  add_if(
      scenario.get<LocaliserSettings>().place != LocaliserSettings::Place::none, reasons,
      "localiser.place: must be \"none\"; poses from a scanner have errors that the place decides");
  add_if(!scenario.get<FleetSettings>().is_one(), reasons, "fleet.count: must be 1");
  add_if(scenario.get<Surroundings>().any(), reasons,
         "obstacles and maps: must not be there; touching something is not linear");
  add_if(scenario.get<PathSettings>().point != PathSettings::Point::axle, reasons,
         "path.point = \"chassis\": must be \"axle\"");
  const auto& s = scenario.get<SensorSettings>();
  add_if(s.send != SensorSettings::Send::always, reasons,
         "sensor.send = \"changed\": must be \"always\"; what is sent depends on the errors");
  add_if(s.dropouts_per_min > 0.0, reasons, "sensor.dropouts_per_min: must be 0");
}

void link_obstacles(const std::string& prefix, const LinkConfig& link, Reasons& reasons) {
  if (link.model != "fixed" && link.model != "gilbert_elliott") {
    reasons.push_back(fmt::format("{}model = \"{}\": must be \"fixed\" or \"gilbert_elliott\"",
                                  prefix, link.model));
  }
  for (const LinkStageKind& stage : link_stage_kinds()) {
    const bool harmless = stage.name == "loss" || stage.name == "room" || stage.name == "in_order";
    if (harmless || stage.on == nullptr || !stage.on(link)) continue;
    reasons.push_back(fmt::format(
        "{}{}: must be off; delays must be constant, and losses the model's", prefix, stage.name));
  }
}

void channel_obstacles(const Scenario& scenario, Reasons& reasons) {
  const auto& channel = scenario.get<ChannelSettings>();
  link_obstacles("channel.uplink.", channel.uplink, reasons);
  link_obstacles("channel.downlink.", channel.downlink, reasons);
  add_if(channel.shared_state, reasons, "channel.shared_state: must be false");
  add_if(!channel.changes.empty(), reasons,
         "channel.changes: must be empty; losses must have one law all the time");
  add_if(scenario.get<MediumSettings>().model != MediumSettings::Model::none, reasons,
         "medium.model: must be \"none\"; what a shared radio does is no chain");
}

ChainLink chain_of(const LinkConfig& link, double period_s) {
  const LinkExpectation expected = expect_link(link, {.interval_s = period_s});
  ChainLink chain;
  chain.prr.clear();
  for (const ExpectedState& state : expected.channel->states()) chain.prr.push_back(state.prr);
  if (link.model == "gilbert_elliott") {
    const auto& ge = link.own.get<GilbertElliottConfig>();
    const double p = ge.p.value_or(0.0), r = ge.r.value_or(1.0);
    chain.transition = {{1.0 - p, p}, {r, 1.0 - r}};
    chain.steps_by_packets = true;
  }
  return chain;
}

/// The loop of a scenario, on a straight at its path's greatest speed.
struct StraightLoop {
  TrackingGains gains;
  LoopTiming timing;
  PoseNoise noise;
  double v_mps = 0.0, least_mps = 0.0;
  ChainLink uplink, downlink;

  explicit StraightLoop(const Scenario& scenario)
      : gains(scenario.get<ControllerSettings>().tracking) {
    const auto& sensor = scenario.get<SensorSettings>();
    const auto& channel = scenario.get<ChannelSettings>();
    timing = {1.0 / sensor.rate_hz, 1e-3 * (sensor.latency_ms + channel.uplink.fixed.delay_ms),
              1e-3 * channel.downlink.fixed.delay_ms};
    noise = {sensor.position_noise_m, sensor.yaw_noise_rad};
    uplink = chain_of(channel.uplink, timing.period_s);
    downlink = chain_of(channel.downlink, timing.period_s);
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
  }

  LoopStep step(const LoopTiming& with) const {
    const PathMotion motion{v_mps, 0.0};
    return sampled_step(
        {motion, motion, motion, tracking_jacobian(gains.k_x, gains.k_y, gains.k_theta, v_mps)},
        with, noise);
  }
  double radius(const LossChain& chain, LoopPart part = LoopPart::all) const {
    return mean_square_radius(chain, {part_of(step(timing), part)});
  }
};

Critical critical_delay(const StraightLoop& loop, const LossChain& chain) {
  constexpr double kMost_s = 0.5;
  constexpr double kMostPeriods = 12.0;  // under way: the state grows by two for each
  const double most_s = std::min(kMost_s, kMostPeriods * loop.timing.period_s);
  return critical_value(
      [&](double delay_s) {
        const LoopTiming late{loop.timing.period_s, delay_s, 0.0};
        const LoopStep step = loop.step(late);
        return std::max(mean_square_radius(chain, {part_of(step, LoopPart::across)}),
                        mean_square_radius(chain, {part_of(step, LoopPart::along)}));
      },
      0.0, most_s, 1e-4);
}

Critical critical_burst(const StraightLoop& loop) {
  const auto prr_of = [](const ChainLink& link) {
    return link.transition[1][0] / (link.transition[0][1] + link.transition[1][0]);
  };
  const double up = prr_of(loop.uplink), down = prr_of(loop.downlink);
  const double least = std::max({1.0, (1.0 - up) / up, (1.0 - down) / down});
  return critical_value(
      [&](double burst) {
        return loop.radius(
            both_links(ChainLink::bursts(up, burst), ChainLink::bursts(down, burst)));
      },
      least, std::max(200.0, 2.0 * least), 1e-3);
}

/// Links that lose nothing but in one of two states.
bool is_bursty(const ChainLink& link) {
  return link.prr.size() == 2 && link.prr[0] == 1.0 && link.prr[1] == 0.0 &&
         link.transition[0][1] > 0.0 && link.transition[1][0] > 0.0;
}

bool is_white(const SensorSettings& s) {
  return s.noise_correlation_s == 0.0 && s.bias_x_m == 0.0 && s.bias_y_m == 0.0 &&
         s.bias_yaw_rad == 0.0 && s.position_drift_mpsqrts == 0.0 && s.yaw_drift_radpsqrts == 0.0 &&
         s.jumps_per_min == 0.0;
}

}  // namespace

std::vector<std::string> margin_obstacles(const Scenario& scenario) {
  Reasons reasons;
  controller_obstacles(scenario, reasons);
  vehicle_obstacles(scenario, reasons);
  channel_obstacles(scenario, reasons);
  return reasons;
}

LoopMargins loop_margins(const Scenario& scenario) {
  if (const Reasons reasons = margin_obstacles(scenario); !reasons.empty()) {
    std::string text = "margin: the theory does not hold for this scenario:";
    for (const std::string& reason : reasons) text += "\n  " + reason;
    throw UsageError(text);
  }
  const StraightLoop loop(scenario);
  if (!(loop.v_mps > 0.0)) {
    throw UsageError("margin: the path rests from run.settled_from_s on: nothing steers there");
  }
  const LossChain chain = both_links(loop.uplink, loop.downlink);
  LoopMargins m;
  m.v_mps = loop.v_mps;
  m.least_mps = loop.least_mps;
  m.period_s = loop.timing.period_s;
  m.delay_s = loop.timing.total_s();
  m.prr = chain.prr();
  m.radius_across = loop.radius(chain, LoopPart::across);
  m.radius_along = loop.radius(chain, LoopPart::along);
  m.radius = std::max(m.radius_across, m.radius_along);
  m.prr_each_way = critical_value(
      [&](double prr) {
        return loop.radius(both_links(ChainLink::independent(prr), ChainLink::independent(prr)));
      },
      0.01, 1.0, 1e-5);
  if (is_bursty(loop.uplink) && is_bursty(loop.downlink)) m.mean_burst = critical_burst(loop);
  m.delay_total_s = critical_delay(loop, chain);
  const SteeringLoop steering{loop.gains.k_y, loop.gains.k_theta, loop.v_mps};
  m.delay_margin_s = steering.delay_margin_s();
  m.varying_delay_margin_s = steering.varying_delay_margin_s();
  if (!is_white(scenario.get<SensorSettings>()) || m.radius >= 1.0) return m;
  if (const auto moments = stationary_moments(chain, {loop.step(loop.timing)})) {
    m.rms_m = std::sqrt(square_distance(moments->front(), {loop.v_mps, 0.0}, loop.timing));
  }
  return m;
}

}  // namespace tether
