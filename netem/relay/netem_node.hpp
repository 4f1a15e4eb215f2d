#pragma once

#include <cstdint>
#include <string>

#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/bus/counter_reporter.hpp"
#include "common/bus/sole_sender.hpp"
#include "common/loop/event_loop.hpp"
#include "common/loop/node.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/relay/companion_link.hpp"
#include "netem/relay/live_settings.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/relay/running_link.hpp"

namespace tether {

/// The relay between the two sides of the network: AGV/POSE → uplink → CTRL/POSE, and
/// CTRL/CMD_VEL → downlink → AGV/CMD_VEL and CTRL/PLAN → downlink → AGV/PLAN, as raw bytes.
/// AGV/ODOMETRY → CTRL/ODOMETRY goes beside the poses (CompanionLink) and changes nothing for them;
/// reports are about poses alone. What is
/// handed over before departure, CTRL/PRELOAD → AGV/PRELOAD, passes by the links. Reports on
/// NET/UPLINK and NET/DOWNLINK every run.report_period_s and at each change of a channel's state or
/// settings. While several programs send on one of these channels at the same time it relays none
/// of their messages ("senders.refused"): which of them counts, nobody could say. Takes other
/// settings from NET/SET, from either side, and answers on NET/SETTINGS; publishes those of
/// channel.change there itself, at their times. Only for models that need the vehicle's position
/// does it decode AGV/POSE, before the uplink takes it; what cannot be decoded is counted.
class NetemNode final : public Node {
 public:
  /// Both sides may be the same bus; else reports go to both, and SIM/CLOCK is passed on as it is.
  NetemNode(const NetemSettings& settings, EventLoop& loop, Bus& vehicle_bus, Bus& control_bus);

  /// Publishes the final reports.
  void finish() override;

  const Link& uplink() const { return uplink_.link(); }
  const Link& downlink() const { return downlink_.link(); }
  /// For observers.
  Link& uplink() { return uplink_.link(); }
  Link& downlink() { return downlink_.link(); }

 private:
  NetemNode(const NetemSettings& settings, const ChannelModels& models, EventLoop& loop,
            Bus& vehicle_bus, Bus& control_bus);
  NetemNode(const NetemSettings& settings, const ChannelModels& models, LinkPair links,
            EventLoop& loop, Bus& vehicle_bus, Bus& control_bus);
  RunningLink::Report report_on(const std::string& channel);
  void connect(Bus& in, const std::string& in_channel, RunningLink& link,
               const std::string& out_channel);
  bool refuses(const Message& message);
  void watch_position();
  bool wants_position() const;
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& vehicle_bus_;
  Bus& control_bus_;
  bool wants_position_;
  std::int64_t undecodable_positions_ = 0;
  std::int64_t preloads_ = 0;
  std::int64_t refused_ = 0;
  ChannelNames channels_;
  SoleSender vehicle_senders_;
  SoleSender control_senders_;
  CounterReporter counters_;
  RunningLink uplink_;
  RunningLink downlink_;
  CompanionLink odometry_;
  LiveSettings settings_;
};

}  // namespace tether
