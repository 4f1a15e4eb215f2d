#include "netem/relay/netem_node.hpp"

#include <cmath>
#include <tether/link_report_t.hpp>
#include <tether/pose_t.hpp>
#include <utility>

#include "common/bus/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

RunningLink::Deliver publish_on(Bus& bus) {
  return [&bus](const Packet& packet) { bus.publish(packet.channel, packet.bytes); };
}

}  // namespace

NetemNode::NetemNode(const NetemSettings& settings, EventLoop& loop, Bus& vehicle_bus,
                     Bus& control_bus)
    : NetemNode(settings, make_models(settings), loop, vehicle_bus, control_bus) {}

NetemNode::NetemNode(const NetemSettings& settings, const ChannelModels& models, EventLoop& loop,
                     Bus& vehicle_bus, Bus& control_bus)
    : NetemNode(settings, models, make_links(settings, models), loop, vehicle_bus, control_bus) {}

NetemNode::NetemNode(const NetemSettings& settings, const ChannelModels& models, LinkPair links,
                     EventLoop& loop, Bus& vehicle_bus, Bus& control_bus)
    : loop_(loop),
      vehicle_bus_(vehicle_bus),
      control_bus_(control_bus),
      wants_position_(links.uplink.process().wants_position() ||
                      links.downlink.process().wants_position()),
      channels_(settings.get<VehicleSettings>().name),
      vehicle_senders_(loop, vehicle_bus, {channels_.vehicle_pose, channels_.vehicle_odometry}),
      control_senders_(
          loop, control_bus,
          {channels_.control_command, channels_.control_plan, channels_.control_preload}),
      counters_(loop, vehicle_bus, "netem", channels_.net_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }),
      uplink_("uplink", std::move(links.uplink), loop,
              from_seconds(settings.get<RunSettings>().report_period_s), publish_on(control_bus),
              report_on(channels_.uplink_report)),
      downlink_("downlink", std::move(links.downlink), loop,
                from_seconds(settings.get<RunSettings>().report_period_s), publish_on(vehicle_bus),
                report_on(channels_.downlink_report)),
      odometry_(settings, "odometry", "uplink", uplink_.link(), loop, publish_on(control_bus)),
      settings_(settings, models, kVehicleLinks, {&uplink_, &downlink_}, loop,
                {&vehicle_bus, &control_bus}, [this] {
                  wants_position_ = wants_position();
                  odometry_.renew(settings_.in_force());
                }) {
  watch_position();
  connect(vehicle_bus, channels_.vehicle_pose, uplink_, channels_.control_pose);
  connect(control_bus, channels_.control_command, downlink_, channels_.vehicle_command);
  connect(control_bus, channels_.control_plan, downlink_, channels_.vehicle_plan);
  vehicle_bus.subscribe(channels_.vehicle_odometry, kDeepQueue, [this](const Message& message) {
    if (refuses(message)) return;
    odometry_.take({channels_.control_odometry, {message.bytes.begin(), message.bytes.end()}});
  });
  control_bus.subscribe(channels_.control_preload, kDeepQueue, [this](const Message& message) {
    if (refuses(message)) return;
    ++preloads_;
    vehicle_bus_.publish(channels_.vehicle_preload, message.bytes);
  });
  if (&control_bus != &vehicle_bus) {
    vehicle_bus.subscribe(channels_.clock, 1, [&control_bus](const Message& message) {
      control_bus.publish(message.channel, message.bytes);
    });
  }
}

RunningLink::Report NetemNode::report_on(const std::string& channel) {
  return [this, channel](const link_report_t& report) {
    publish(vehicle_bus_, channel, report);
    if (&control_bus_ != &vehicle_bus_) publish(control_bus_, channel, report);
  };
}

void NetemNode::connect(Bus& in, const std::string& in_channel, RunningLink& link,
                        const std::string& out_channel) {
  in.subscribe(in_channel, kDeepQueue, [this, &link, out_channel](const Message& message) {
    if (refuses(message)) return;
    link.take({out_channel, {message.bytes.begin(), message.bytes.end()}});
  });
}

bool NetemNode::refuses(const Message& message) {
  const bool refused =
      vehicle_senders_.several(message.channel) || control_senders_.several(message.channel);
  if (refused) ++refused_;
  return refused;
}

void NetemNode::watch_position() {
  vehicle_bus_.subscribe(channels_.vehicle_pose, kDeepQueue, [this](const Message& message) {
    if (!wants_position_) return;
    pose_t pose{};
    if (!decode(message.bytes, pose) || !std::isfinite(pose.x_m) || !std::isfinite(pose.y_m)) {
      ++undecodable_positions_;
      return;
    }
    for (RunningLink* running : {&uplink_, &downlink_}) {
      running->link().process().on_position(pose.x_m, pose.y_m, loop_.now());
    }
  });
}

bool NetemNode::wants_position() const {
  return uplink().process().wants_position() || downlink().process().wants_position();
}

void NetemNode::finish() {
  uplink_.report();
  downlink_.report();
  counters_.publish_now();
}

void NetemNode::list_counters(CounterList& out) const {
  uplink_.list_counters(out);
  downlink_.list_counters(out);
  odometry_.list_counters(out);
  if (wants_position_) out.emplace_back("undecodable_positions", undecodable_positions_);
  if (preloads_ > 0) out.emplace_back("preloads", preloads_);
  vehicle_senders_.list(out);
  control_senders_.list(out);
  if (refused_ > 0) out.emplace_back("senders.refused", refused_);
  settings_.list_counters(out);
}

}  // namespace tether
