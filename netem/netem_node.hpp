#pragma once

#include <cstdint>
#include <string>

#include "common/bus.hpp"
#include "common/channel_names.hpp"
#include "common/counter_reporter.hpp"
#include "common/event_loop.hpp"
#include "common/node.hpp"
#include "common/scenario.hpp"
#include "netem/make_links.hpp"

namespace tether {

/// The relay between the two sides of the network: AGV/POSE → uplink → CTRL/POSE, and
/// CTRL/CMD_VEL → downlink → AGV/CMD_VEL, as raw bytes. Reports on NET/UPLINK and NET/DOWNLINK
/// every run.report_period_s and at each change of a channel's state. Only for models that need the
/// vehicle's position does it decode AGV/POSE, before the uplink takes it; what cannot be decoded
/// is counted.
class NetemNode final : public Node {
 public:
  /// Both sides may be the same bus; else reports go to both, and SIM/CLOCK is passed on as it is.
  NetemNode(const Scenario& scenario, EventLoop& loop, Bus& vehicle_bus, Bus& control_bus);

  /// Publishes the final reports.
  void finish() override;

  const Link& uplink() const { return links_.uplink; }
  const Link& downlink() const { return links_.downlink; }
  /// For observers.
  Link& uplink() { return links_.uplink; }
  Link& downlink() { return links_.downlink; }

 private:
  struct Direction {
    std::string name;
    Link& link;
    Bus& out;
    std::string out_channel;
    std::string report_channel;
    std::int64_t report_seq = 0;
  };
  void start(Direction& direction, Bus& in, const std::string& in_channel, Duration period);
  void watch_position(Bus& vehicle_bus);
  void on_packet(Direction& direction, const Message& message);
  void deliver_at(Direction& direction, Instant departure);
  void deliver(Direction& direction, Instant now);
  void watch_state(Direction& direction);
  void report(Direction& direction);
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& vehicle_bus_;
  Bus& control_bus_;
  LinkPair links_;
  bool wants_position_;
  std::int64_t undecodable_positions_ = 0;
  ChannelNames channels_;
  Direction uplink_;
  Direction downlink_;
  CounterReporter counters_;
};

}  // namespace tether
