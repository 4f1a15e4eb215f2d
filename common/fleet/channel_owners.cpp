#include "common/fleet/channel_owners.hpp"

#include "common/node/channel_names.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"

namespace tether {
namespace {

void add_owners(const Scenario& scenario, ChannelOwners& owners) {
  const ChannelNames c(scenario.get<VehicleSettings>().name);
  const auto add = [&owners](const std::string& node, const std::vector<std::string>& channels) {
    for (const std::string& channel : channels) owners[channel] = node;
  };
  add("sim", {c.vehicle_pose, c.vehicle_odometry, c.vehicle_scan, c.vehicle_scan_part, c.clock,
              c.truth, c.sim_counters, c.wheel_states});
  add("netem", {c.control_pose, c.control_odometry, c.control_scan_part, c.control_localisation,
                c.control_autonomy, c.vehicle_command, c.vehicle_plan, c.vehicle_preload,
                c.uplink_report, c.downlink_report, c.net_counters, c.net_set, c.net_settings});
  add("controller",
      {c.control_command, c.control_plan, c.control_preload, c.control_report, c.control_counters});
  add("can", {c.can_request, c.can_inject, c.can_state, c.can_wheels, c.can_odometry, c.can_plan,
              c.can_counters, c.drive_counters, c.wheel_targets});
  add("autonomy", {c.vehicle_autonomy, c.vehicle_drive, c.autonomy_counters});
  add("localiser", {c.localiser_counters, c.vehicle_localisation});
  using Place = LocaliserSettings::Place;
  const Place place = scenario.get<LocaliserSettings>().place;
  if (place == Place::vehicle) add("localiser", {c.vehicle_pose});
  if (place == Place::edge) add("localiser", {c.control_pose, c.control_localisation});
}

}  // namespace

ChannelOwners channel_owners(const std::vector<Scenario>& members) {
  ChannelOwners owners;
  for (const Scenario& scenario : members) add_owners(scenario, owners);
  return owners;
}

}  // namespace tether
