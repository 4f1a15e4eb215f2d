#include <fmt/format.h>

#include <cmath>
#include <cstdint>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/path/path_settings.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/surroundings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/fit/link_expectation.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/models/chain.hpp"
#include "netem/models/kinds.hpp"
#include "netem/stages/kinds.hpp"
#include "netem/stages/room.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tools/margin/straight_loop.hpp"

namespace tether {
namespace {

using Reasons = std::vector<std::string>;

void add_if(bool condition, Reasons& reasons, const char* why) {
  if (condition) reasons.emplace_back(why);
}

void pid_obstacles(const ControllerSettings& c, Reasons& reasons) {
  add_if(c.v.i != 0.0 || c.v.d != 0.0 || c.omega.i != 0.0 || c.omega.d != 0.0, reasons,
         "controller.v.i, .v.d, .omega.i, .omega.d: must be 0; they remember poses, and what they "
         "do depends on the time between two");
  add_if(!(c.v.p > 0.0 && c.omega.p > 0.0), reasons,
         "controller.v.p, .omega.p: must be above 0; else nothing corrects");
}

/// Whether one number is a whole multiple of another.
bool is_multiple(double of, double part) {
  constexpr double kRounding = 1e-9;
  const double times = of / part;
  return times > 0.5 && std::abs(times - std::round(times)) <= kRounding * times;
}

void plan_obstacles(const Scenario& scenario, Reasons& reasons) {
  const auto& sensor = scenario.get<SensorSettings>();
  const double step_s = to_seconds(scenario.get<ControllerSettings>().plan_step());
  if (!is_multiple(1.0 / sensor.rate_hz, step_s)) {
    reasons.push_back(
        fmt::format("controller.plan_step_ms: 1/sensor.rate_hz = {:g} ms must be a whole multiple "
                    "of it; else plans are left within a step",
                    1e3 / sensor.rate_hz));
  }
  const auto& channel = scenario.get<ChannelSettings>();
  const double links_s = only_delay_s(channel.uplink) + only_delay_s(channel.downlink);
  add_if(sensor.latency_ms > 0.0 || links_s > 0.0, reasons,
         "controller.law: with plans, sensor.latency_ms and the links' delays must be 0; what the "
         "vehicle does until a plan arrives is predicted, and not in the theory");
}

void controller_obstacles(const Scenario& scenario, Reasons& reasons) {
  const auto& c = scenario.get<ControllerSettings>();
  const bool plans = has_linear_plans(c);
  if (c.law != "tracking" && c.law != "pid" && !plans) {
    reasons.push_back(
        fmt::format("controller.law = \"{}\": must be \"tracking\", \"pid\", \"predictive\" or "
                    "\"predictive_consistent\"; others optimise, or remember",
                    c.law));
  }
  if (c.law == "pid") pid_obstacles(c, reasons);
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
  if (plans) {
    plan_obstacles(scenario, reasons);
  } else {
    add_if(scenario.get<ActuatorSettings>().policy != "hold", reasons,
           "actuator.policy: must be \"hold\"; other policies act on the time without commands");
  }
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

/// A chain that steps in time is one from pose to pose only if poses come at whole steps.
void check_steps(const std::string& prefix, const LinkConfig& link, double period_s,
                 Reasons& reasons) {
  if (link.model != "chain") return;
  const double step_s = link.own.get<ChainConfig>().step_s;
  if (step_s == 0.0 || is_multiple(period_s, step_s)) return;
  reasons.push_back(fmt::format(
      "{}chain.step_s = {:g}: must be 0, or 1/sensor.rate_hz = {:g} s a whole multiple of it; else "
      "poses meet the steps at other times each",
      prefix, step_s, period_s));
}

/// Packets beyond the queue's room are lost, mostly after a delay.
void check_room(const std::string& prefix, const LinkConfig& link, double period_s,
                Reasons& reasons) {
  constexpr std::int64_t kPacketBytes = 1000;  // a pose or command is shorter
  const auto& room = link.own.get<RoomSettings>();
  const auto most = static_cast<std::int64_t>(std::ceil(only_delay_s(link) / period_s)) + 1;
  if (room.packets >= most && room.bytes >= most * kPacketBytes) return;
  reasons.push_back(
      fmt::format("{0}queue_limit, {0}queue_limit_bytes: must be at least {1} and {2}, as much as "
                  "is under way; else packets are dropped",
                  prefix, most, most * kPacketBytes));
}

void link_obstacles(const std::string& prefix, const LinkConfig& link, double period_s,
                    Reasons& reasons) {
  const ChannelModelKind& kind = kind_of(link);
  if (kind.expect == nullptr) {
    reasons.push_back(
        fmt::format("{}model = \"{}\": must be \"fixed\", \"markov\", \"gilbert_elliott\", "
                    "\"four_state\" or \"chain\"; {}",
                    prefix, link.model, kind.why_open));
    return;
  }
  if (kind.only_delay_ms == nullptr || !kind.only_delay_ms(link)) {
    reasons.push_back(
        fmt::format("{}model = \"{}\": must have one delay in all states; delays must be constant",
                    prefix, link.model));
  } else {
    check_room(prefix, link, period_s, reasons);
  }
  check_steps(prefix, link, period_s, reasons);
  for (const LinkStageKind& stage : link_stage_kinds()) {
    const bool harmless = stage.name == "loss" || stage.name == "room" || stage.name == "in_order";
    if (harmless || stage.on == nullptr || !stage.on(link)) continue;
    reasons.push_back(fmt::format(
        "{}{}: must be off; delays must be constant, and losses the model's", prefix, stage.name));
  }
  const LinkExpectation expected = expect_link(link, {.interval_s = period_s});
  if (!expected.no_losses.empty()) {
    reasons.push_back(fmt::format("{}model = \"{}\": {}", prefix, link.model, expected.no_losses));
  }
}

void channel_obstacles(const Scenario& scenario, Reasons& reasons) {
  const auto& channel = scenario.get<ChannelSettings>();
  const double period_s = 1.0 / scenario.get<SensorSettings>().rate_hz;
  link_obstacles("channel.uplink.", channel.uplink, period_s, reasons);
  link_obstacles("channel.downlink.", channel.downlink, period_s, reasons);
  add_if(channel.shared_state && only_delay_s(channel.uplink) > 0.0, reasons,
         "channel.shared_state = true: must be false, or the uplink's delay 0; else the state "
         "moves between a pose and its answer");
  add_if(!channel.changes.empty(), reasons,
         "channel.change: must be empty; losses must have one law all the time");
  add_if(scenario.get<MediumSettings>().model != MediumSettings::Model::none, reasons,
         "medium.model: must be \"none\"; what a shared radio does is no chain");
}

void refuse(const Reasons& reasons) {
  if (reasons.empty()) return;
  std::string text = "margin: the theory does not hold for this scenario:";
  for (const std::string& reason : reasons) text += "\n  " + reason;
  throw UsageError(text);
}

}  // namespace

std::vector<std::string> margin_obstacles(const Scenario& scenario) {
  Reasons reasons;
  controller_obstacles(scenario, reasons);
  vehicle_obstacles(scenario, reasons);
  channel_obstacles(scenario, reasons);
  return reasons;
}

void refuse_margin_obstacles(const Scenario& scenario) { refuse(margin_obstacles(scenario)); }

void refuse_channel_obstacles(const Scenario& scenario) {
  Reasons reasons;
  channel_obstacles(scenario, reasons);
  refuse(reasons);
}

}  // namespace tether
