#include "netem/netem_node.hpp"

#include <cmath>
#include <tether/link_report_t.hpp>
#include <tether/pose_t.hpp>
#include <utility>

#include "common/message_io.hpp"

namespace tether {

NetemNode::NetemNode(const Scenario& scenario, EventLoop& loop, Bus& vehicle_bus, Bus& control_bus)
    : loop_(loop),
      vehicle_bus_(vehicle_bus),
      control_bus_(control_bus),
      links_(make_links(scenario)),
      wants_position_(links_.uplink.process().wants_position() ||
                      links_.downlink.process().wants_position()),
      channels_(scenario.vehicle.name),
      uplink_{"uplink", links_.uplink, control_bus, channels_.control_pose,
              channels_.uplink_report},
      downlink_{"downlink", links_.downlink, vehicle_bus, channels_.vehicle_command,
                channels_.downlink_report},
      counters_(loop, vehicle_bus, "netem", channels_.net_counters,
                from_seconds(scenario.run.report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  const Duration period = from_seconds(scenario.run.report_period_s);
  watch_position(vehicle_bus);
  start(uplink_, vehicle_bus, channels_.vehicle_pose, period);
  start(downlink_, control_bus, channels_.control_command, period);
  if (&control_bus != &vehicle_bus) {
    vehicle_bus.subscribe(channels_.clock, 1, [&control_bus](const Message& message) {
      control_bus.publish(message.channel, message.bytes);
    });
  }
}

void NetemNode::start(Direction& direction, Bus& in, const std::string& in_channel,
                      Duration period) {
  in.subscribe(in_channel, kDeepQueue,
               [this, &direction](const Message& message) { on_packet(direction, message); });
  loop_.every(kStart, period, Priority::observer,
              [this, &direction](Instant) { report(direction); });
  direction.link.process().advance(loop_.now());
  watch_state(direction);
}

void NetemNode::watch_position(Bus& vehicle_bus) {
  if (!wants_position_) return;
  subscribe<pose_t>(vehicle_bus, channels_.vehicle_pose, kDeepQueue, undecodable_positions_,
                    [this](const pose_t& pose) {
                      if (!std::isfinite(pose.x_m) || !std::isfinite(pose.y_m)) {
                        ++undecodable_positions_;
                        return;
                      }
                      const Instant now = loop_.now();
                      for (Link* link : {&links_.uplink, &links_.downlink}) {
                        link->process().on_position(pose.x_m, pose.y_m, now);
                      }
                    });
}

void NetemNode::on_packet(Direction& direction, const Message& message) {
  const Instant now = loop_.now();
  const Instant departure = direction.link.push(
      now, {direction.out_channel, {message.bytes.begin(), message.bytes.end()}});
  const Instant copy_departure = direction.link.copy_departure();
  deliver_at(direction, departure);
  deliver_at(direction, copy_departure);
}

void NetemNode::deliver_at(Direction& direction, Instant departure) {
  if (departure <= loop_.now()) {
    deliver(direction, loop_.now());
  } else if (departure != Instant::max()) {
    loop_.at(departure, Priority::delivery,
             [this, &direction](Instant) { deliver(direction, loop_.now()); });
  }
}

void NetemNode::deliver(Direction& direction, Instant now) {
  direction.link.pop_ready(now, [&direction](const Packet& packet) {
    direction.out.publish(packet.channel, packet.bytes);
  });
}

void NetemNode::watch_state(Direction& direction) {
  const Instant next = direction.link.process().next_transition();
  if (next == Instant::max()) return;
  loop_.at(next, Priority::observer, [this, &direction](Instant scheduled) {
    direction.link.process().advance(scheduled);
    report(direction);
    watch_state(direction);
  });
}

void NetemNode::report(Direction& direction) {
  const Link& link = direction.link;
  const Link::Counters& c = link.counters();
  const DelayHistogram& delays = link.delays();

  link_report_t message{};
  message.utime = to_utime(loop_.now());
  message.seq = direction.report_seq++;
  message.link = direction.name;
  const LinkCondition condition = link.process().condition();
  message.state = link.process().state();
  message.state_prr = condition.prr;
  message.state_delay_ms = to_milliseconds(condition.delay);
  message.offered = c.offered + c.duplicated;
  message.lost = c.lost + c.outage_dropped;
  message.overflowed = c.overflowed;
  message.delivered = c.delivered;
  message.in_flight = link.in_flight();
  message.delivered_bytes = c.delivered_bytes;
  message.delay_ms_mean = to_milliseconds(delays.mean());
  message.delay_ms_p50 = to_milliseconds(delays.quantile(0.50));
  message.delay_ms_p90 = to_milliseconds(delays.quantile(0.90));
  message.delay_ms_p99 = to_milliseconds(delays.quantile(0.99));
  message.delay_ms_max = to_milliseconds(delays.max());
  publish(vehicle_bus_, direction.report_channel, message);
  if (&control_bus_ != &vehicle_bus_) publish(control_bus_, direction.report_channel, message);
}

void NetemNode::finish() {
  report(uplink_);
  report(downlink_);
  counters_.publish_now();
}

void NetemNode::list_counters(CounterList& out) const {
  for (const Direction* d : {&uplink_, &downlink_}) {
    const Link::Counters& c = d->link.counters();
    out.emplace_back(d->name + ".offered", c.offered);
    out.emplace_back(d->name + ".lost", c.lost);
    out.emplace_back(d->name + ".overflowed", c.overflowed);
    out.emplace_back(d->name + ".delivered", c.delivered);
    const std::pair<const char*, std::int64_t> rare[] = {{".outage_dropped", c.outage_dropped},
                                                         {".duplicated", c.duplicated},
                                                         {".corrupted", c.corrupted},
                                                         {".reordered", c.reordered}};
    for (const auto& [name, value] : rare) {
      if (value > 0) out.emplace_back(d->name + name, value);
    }
  }
  if (wants_position_) out.emplace_back("undecodable_positions", undecodable_positions_);
}

}  // namespace tether
