#include "scenarios/radio_traffic.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <tether/localisation_t.hpp>
#include <tether/odometry_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/node/channel_names.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/scan.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "netem/medium/medium_settings.hpp"
#include "onboard/autonomy/autonomy_section.hpp"
#include "sim/sensor/lidar_settings.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {
namespace {

using Place = LocaliserSettings::Place;
using Stream = MediumSettings::Stream;

/// Poses, from any source.
Stream poses(const Scenario& scenario, const ChannelNames& channels) {
  const auto& sensor = scenario.get<SensorSettings>();
  const std::int64_t bytes = datagram_bytes(channels.control_pose, pose_t{}.getEncodedSize());
  if (scenario.get<LocaliserSettings>().place != Place::none) {
    return {scenario.get<LidarSettings>().rate_hz, bytes};
  }
  if (!sends_changes(sensor)) return {sensor.rate_hz, bytes};
  return {std::min(sensor.rate_hz, 1.0 / sensor.send_max_age_s), bytes, sensor.rate_hz};
}

/// Commands or plans, for poses of which all arrive.
Stream commands(const Scenario& scenario, const ChannelNames& channels, const Stream& up) {
  const auto& controller = scenario.get<ControllerSettings>();
  const bool by_timer = controller.trigger == ControllerSettings::Trigger::timer;
  Stream down = by_timer ? Stream{controller.rate_hz, 0} : Stream{up.rate_hz, 0, up.most_hz};
  if (sends_changes(controller)) {
    down.most_hz = down.highest_hz();
    down.rate_hz = std::min(down.rate_hz, 1.0 / controller.send_max_age_s);
  }
  if (!kind_of(controller).sends_plans) {
    down.bytes = datagram_bytes(channels.vehicle_command, twist_t{}.getEncodedSize());
    return down;
  }
  plan_t plan{};
  plan.count = static_cast<std::int32_t>(controller.plan_steps());
  down.bytes = datagram_bytes(channels.vehicle_plan, plan.getEncodedSize());
  return down;
}

/// A turn's parts, as the vehicle makes them.
void add_scan_parts(const Scenario& scenario, const ChannelNames& channels,
                    std::vector<Stream>& streams) {
  const auto& lidar = scenario.get<LidarSettings>();
  Scan scan{};
  scan.range_m.resize(static_cast<std::size_t>(lidar.beams));
  const auto most = static_cast<std::size_t>(scenario.get<LocaliserSettings>().part_bytes);
  for (const scan_part_t& part : scan_parts(scan, 0, 0, most, 1.0)) {
    streams.push_back(
        {lidar.rate_hz, datagram_bytes(channels.control_scan_part, part.getEncodedSize())});
  }
}

}  // namespace

void take_traffic(Scenario& scenario) {
  auto& medium = scenario.get<MediumSettings>();
  const auto& fleet = scenario.get<FleetSettings>();
  medium.together = fleet.count > 1 && fleet.ticks == FleetSettings::Ticks::together;
  const ChannelNames channels(scenario.get<VehicleSettings>().name);
  const Place place = scenario.get<LocaliserSettings>().place;
  const bool scans = place != Place::none && scenario.get<LidarSettings>().on();
  medium.vehicles = scenario.get<FleetSettings>().count;
  medium.up = poses(scenario, channels);
  medium.down = commands(scenario, channels, medium.up);
  medium.poses_go_up = place != Place::edge;
  medium.more_up.clear();
  if (const double rate_hz = scenario.get<SensorSettings>().odometry_rate_hz; rate_hz > 0.0) {
    medium.more_up.push_back(
        {rate_hz, datagram_bytes(channels.control_odometry, odometry_t{}.getEncodedSize())});
  }
  if (scans && place == Place::edge) add_scan_parts(scenario, channels, medium.more_up);
  if (scans && place == Place::vehicle) {
    medium.more_up.push_back(
        {scenario.get<LidarSettings>().rate_hz,
         datagram_bytes(channels.control_localisation, localisation_t{}.getEncodedSize())});
  }
}

/// A message replaces what its sender has waiting, whatever it is.
void check_keeping(const Scenario& scenario, const std::string& file) {
  const auto& medium = scenario.get<MediumSettings>();
  const bool by_value = medium.serve == ScheduledRules::Serve::most_valuable;
  if (!medium.keep_newest && !by_value) return;
  const bool odometry = scenario.get<SensorSettings>().odometry_rate_hz > 0.0;
  const bool on_board = scenario.get<AutonomySettings>().enabled ||
                        scenario.get<LocaliserSettings>().place != LocaliserSettings::Place::none;
  if (!odometry && !on_board) return;
  throw UsageError(
      fmt::format("{}: medium.{} needs vehicles that send nothing but poses, for {}: {}", file,
                  medium.keep_newest ? "keep = \"newest\"" : "serve = \"most_valuable\"",
                  medium.keep_newest ? "a message replaces another one, whatever it says"
                                     : "what else they send has no value that is known",
                  on_board ? "localiser.place must be \"none\" and autonomy.enabled false"
                           : "sensor.odometry_rate_hz must be 0"));
}

}  // namespace tether
