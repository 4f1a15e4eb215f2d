#pragma once

#include <map>
#include <string>
#include <vector>

#include "common/scenario/run_settings.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/link/link_config.hpp"

namespace tether {

/// [channel]: the network between vehicle and controller.
struct ChannelSettings {
  bool shared_state = false;  ///< both directions follow the uplink's state process
  LinkConfig uplink;
  LinkConfig downlink;
  std::map<std::string, LinkConfig> links;  ///< [channel.links.NAME]: for rules of tether-netem

  /// Other settings from some time on: netem/channel/change.hpp.
  struct Change {
    double at_s = 0.0;
    std::vector<std::string> settings;  ///< "KEY=VALUE", keys without "channel."
  };
  std::vector<Change> changes;  ///< in order of time

  /// Calls f(name, link) for each link: "uplink", "downlink", "links.NAME". Their keys begin with
  /// "channel.<name>.".
  template <class Function>
  void for_each_link(Function f) {
    for_each_link(*this, f);
  }
  template <class Function>
  void for_each_link(Function f) const {
    for_each_link(*this, f);
  }

 private:
  static void for_each_link(auto& channel, auto& f) {
    f(std::string("uplink"), channel.uplink);
    f(std::string("downlink"), channel.downlink);
    for (auto& [name, link] : channel.links) f("links." + name, link);
  }
};

ScenarioSection channel_section();

/// The scenario sections that the network's nodes use.
using NetemSettings = Sections<RunSettings, VehicleSettings, ChannelSettings>;

}  // namespace tether
