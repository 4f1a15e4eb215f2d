#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <string>
#include <vector>

#include "common/fleet/fleet.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"
#include "common/node/sole_sender.hpp"
#include "common/scenario/scenario.hpp"
#include "common/world/onboard_settings.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/relay/live_settings.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/relay/running_link.hpp"

namespace tether {

/// The scenario sections that the vehicle's relay uses.
using VehicleNetemSettings = Sections<RunSettings, VehicleSettings, ChannelSettings, MediumSettings,
                                      LocaliserSettings, FleetSettings>;

/// The relay between the two sides of the network: AGV/POSE → uplink → CTRL/POSE, and
/// CTRL/CMD_VEL → downlink → AGV/CMD_VEL and CTRL/PLAN → downlink → AGV/PLAN, as raw bytes.
/// AGV/ODOMETRY, AGV/SCAN_PART, AGV/LOCALISATION and AGV/AUTONOMY go to CTRL/… beside the poses,
/// each by a CompanionLink of its own, and change nothing for them; reports are about poses alone.
/// What is handed over before departure, CTRL/PRELOAD → AGV/PRELOAD, passes by the links. Reports
/// on NET/UPLINK and NET/DOWNLINK every run.report_period_s and at each change of a channel's state
/// or settings. While several programs send on one of these channels at the same time it relays
/// none of their messages ("senders.refused"): which of them counts cannot be decided. Takes other
/// settings from NET/SET, from either side, and answers on NET/SETTINGS; publishes those of
/// channel.change there itself, at their times. Only for models that need the vehicle's position,
/// of a link or of the medium, does it decode AGV/POSE, before the uplink takes it (SIM/TRUTH where
/// poses are made behind the network); what cannot be decoded is counted.
///
/// With a shared medium all but CTRL/PRELOAD goes over it first (RunningMedium): what it loses no
/// link is offered, and counters "medium.…" tell of it.
class NetemNode final : public Node {
 public:
  /// Both sides may be the same bus; else reports go to both, and SIM/CLOCK is passed on as it is.
  /// `medium`: that of a fleet, where this is the relay of one of its vehicles; the first one
  /// passes the clock and counts for the medium.
  NetemNode(const VehicleNetemSettings& settings, EventLoop& loop, Bus& vehicle_bus,
            Bus& control_bus, std::shared_ptr<RunningMedium> medium = nullptr);

  /// Publishes the final reports.
  void finish() override;

  const Link& uplink() const { return uplink_.link(); }
  const Link& downlink() const { return downlink_.link(); }
  /// For observers.
  Link& uplink() { return uplink_.link(); }
  Link& downlink() { return downlink_.link(); }

 private:
  NetemNode(const VehicleNetemSettings& settings, const ChannelModels& models, EventLoop& loop,
            Bus& vehicle_bus, Bus& control_bus, std::shared_ptr<RunningMedium> medium);
  NetemNode(const VehicleNetemSettings& settings, const ChannelModels& models, LinkPair links,
            EventLoop& loop, Bus& vehicle_bus, Bus& control_bus,
            std::shared_ptr<RunningMedium> medium);
  RunningLink::Report report_on(const std::string& channel);
  /// From a side of the network over the medium to a link, and from there to the other side.
  template <class AnyLink>
  void connect(Way way, const std::string& in_channel, AnyLink& link,
               const std::string& out_channel);
  /// Up, with a link of that name.
  void accompany(const NetemSettings& settings, const std::string& name,
                 const std::string& in_channel, const std::string& out_channel);
  bool refuses(const Message& message);
  void watch_position(bool poses_come_up);
  void on_position(double x_m, double y_m);
  bool wants_position() const;
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& vehicle_bus_;
  Bus& control_bus_;
  bool wants_position_ = false;
  std::int64_t undecodable_positions_ = 0;
  std::int64_t preloads_ = 0;
  std::int64_t refused_ = 0;
  ChannelNames channels_;
  SoleSender vehicle_senders_;
  SoleSender control_senders_;
  CounterReporter counters_;
  std::shared_ptr<RunningMedium> medium_;
  std::size_t number_on_medium_;
  bool is_first_;                           ///< first of its fleet
  std::list<RunningMedium::Deliver> ways_;  ///< behind the medium
  RunningLink uplink_;
  RunningLink downlink_;
  std::list<CompanionLink> beside_;  ///< companions of the uplink
  LiveSettings settings_;
};

/// The relays of all vehicles of a fleet, which share a medium; `members`: of fleet_members().
std::unique_ptr<NodeGroup<NetemNode>> relays_of(const std::vector<Scenario>& members,
                                                EventLoop& loop, Bus& vehicle_bus,
                                                Bus& control_bus);

}  // namespace tether
