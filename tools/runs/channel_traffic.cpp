#include "tools/runs/channel_traffic.hpp"

#include <algorithm>
#include <cmath>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>

#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/kinds.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {
namespace {

/// A twist, or a plan with all its twists.
double command_bytes(const ControllerSettings& controller) {
  if (!kind_of(controller).sends_plans) return twist_t{}.getEncodedSize();
  constexpr double kTwist = 2 * sizeof(float);
  const double twists =
      std::max(1.0, std::round(controller.horizon_s * 1e3 / controller.plan_step_ms));
  return plan_t{}.getEncodedSize() + kTwist * twists;
}

}  // namespace

LinkTraffic pose_traffic(const Scenario& scenario) {
  return {.interval_s = 1.0 / scenario.get<SensorSettings>().rate_hz,
          .packet_bytes = static_cast<double>(pose_t{}.getEncodedSize())};
}

LinkTraffic command_traffic(const Scenario& scenario, bool in_loop) {
  LinkTraffic traffic{.packet_bytes = command_bytes(scenario.get<ControllerSettings>())};
  if (scenario.get<ControllerSettings>().trigger == ControllerSettings::Trigger::timer) {
    traffic.interval_s = 1.0 / scenario.get<ControllerSettings>().rate_hz;
    return traffic;
  }
  traffic.interval_s = 1.0 / scenario.get<SensorSettings>().rate_hz;
  if (!in_loop) return traffic;
  traffic.periodic = false;
  if (scenario.get<ChannelSettings>().shared_state &&
      kind_of(scenario.get<ChannelSettings>().uplink)
              .moves(scenario.get<ChannelSettings>().uplink) != ChannelModelKind::Moves::never) {
    traffic.selected_because =
        "commands answer the poses that arrive, and the state that both directions share decides "
        "which do";
  }
  return traffic;
}

ChannelTraffic channel_traffic(const Scenario& scenario, bool in_loop) {
  ChannelTraffic traffic{pose_traffic(scenario), command_traffic(scenario, in_loop)};
  const bool poses = scenario.get<SensorSettings>().send == SensorSettings::Send::changed;
  const bool commands =
      scenario.get<ControllerSettings>().send == ControllerSettings::Send::changed;
  // More are sent while much changes, and the channel may be another one then.
  const char* because = "they are sent when something changes";
  if (in_loop && poses) traffic.uplink.selected_because = because;
  if (in_loop && (poses || commands)) traffic.downlink.selected_because = because;
  return traffic;
}

}  // namespace tether
