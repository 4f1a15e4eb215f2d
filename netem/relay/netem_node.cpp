#include "netem/relay/netem_node.hpp"

#include <cmath>
#include <tether/ground_truth_t.hpp>
#include <tether/link_report_t.hpp>
#include <tether/pose_t.hpp>
#include <utility>

#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

RunningLink::Deliver publish_on(Bus& bus) {
  return [&bus](const Packet& packet) { bus.publish(packet.channel, packet.bytes); };
}

}  // namespace

NetemNode::NetemNode(const VehicleNetemSettings& settings, EventLoop& loop, Bus& vehicle_bus,
                     Bus& control_bus, std::shared_ptr<RunningMedium> medium)
    : NetemNode(settings, make_models(settings), loop, vehicle_bus, control_bus,
                std::move(medium)) {}

NetemNode::NetemNode(const VehicleNetemSettings& settings, const ChannelModels& models,
                     EventLoop& loop, Bus& vehicle_bus, Bus& control_bus,
                     std::shared_ptr<RunningMedium> medium)
    : NetemNode(settings, models, make_links(settings, models), loop, vehicle_bus, control_bus,
                std::move(medium)) {}

NetemNode::NetemNode(const VehicleNetemSettings& settings, const ChannelModels& models,
                     LinkPair links, EventLoop& loop, Bus& vehicle_bus, Bus& control_bus,
                     std::shared_ptr<RunningMedium> medium)
    : loop_(loop),
      vehicle_bus_(vehicle_bus),
      control_bus_(control_bus),
      channels_(settings.get<VehicleSettings>().name),
      vehicle_senders_(
          loop, vehicle_bus,
          {channels_.vehicle_pose, channels_.vehicle_odometry, channels_.vehicle_scan_part,
           channels_.vehicle_localisation, channels_.vehicle_autonomy}),
      control_senders_(
          loop, control_bus,
          {channels_.control_command, channels_.control_plan, channels_.control_preload}),
      counters_(loop, vehicle_bus, "netem", channels_.net_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }),
      medium_(medium ? std::move(medium)
                     : std::make_shared<RunningMedium>(settings.get<MediumSettings>(),
                                                       settings.get<RunSettings>().seed, loop)),
      number_on_medium_(medium_->add_vehicle(settings.get<VehicleSettings>().name)),
      is_first_(settings.get<FleetSettings>().number == 1),
      uplink_("uplink", std::move(links.uplink), loop,
              from_seconds(settings.get<RunSettings>().report_period_s), publish_on(control_bus),
              report_on(channels_.uplink_report)),
      downlink_("downlink", std::move(links.downlink), loop,
                from_seconds(settings.get<RunSettings>().report_period_s), publish_on(vehicle_bus),
                report_on(channels_.downlink_report)),
      settings_(settings, models, kVehicleLinks, {&uplink_, &downlink_}, loop,
                {&vehicle_bus, &control_bus}, [this] {
                  wants_position_ = wants_position();
                  for (CompanionLink& link : beside_) link.renew(settings_.in_force());
                }) {
  wants_position_ = wants_position();
  watch_position(settings.get<LocaliserSettings>().place != LocaliserSettings::Place::edge);
  connect(Way::up, channels_.vehicle_pose, uplink_, channels_.control_pose);
  connect(Way::down, channels_.control_command, downlink_, channels_.vehicle_command);
  connect(Way::down, channels_.control_plan, downlink_, channels_.vehicle_plan);
  accompany(settings, "odometry", channels_.vehicle_odometry, channels_.control_odometry);
  accompany(settings, "scan_part", channels_.vehicle_scan_part, channels_.control_scan_part);
  accompany(settings, "localisation", channels_.vehicle_localisation,
            channels_.control_localisation);
  accompany(settings, "autonomy", channels_.vehicle_autonomy, channels_.control_autonomy);
  control_bus.subscribe(channels_.control_preload, kDeepQueue, [this](const Message& message) {
    if (refuses(message)) return;
    ++preloads_;
    vehicle_bus_.publish(channels_.vehicle_preload, message.bytes);
  });
  if (&control_bus != &vehicle_bus && is_first_) {
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

template <class AnyLink>
void NetemNode::connect(Way way, const std::string& in_channel, AnyLink& link,
                        const std::string& out_channel) {
  const RunningMedium::Deliver& behind =
      ways_.emplace_back([&link](Packet packet) { link.take(std::move(packet)); });
  Bus& in = way == Way::up ? vehicle_bus_ : control_bus_;
  in.subscribe(in_channel, kDeepQueue, [this, way, &behind, out_channel](const Message& message) {
    if (refuses(message)) return;
    medium_->send(number_on_medium_, way,
                  {out_channel, {message.bytes.begin(), message.bytes.end()}}, behind);
  });
}

void NetemNode::accompany(const NetemSettings& settings, const std::string& name,
                          const std::string& in_channel, const std::string& out_channel) {
  connect(Way::up, in_channel,
          beside_.emplace_back(settings, name, "uplink", uplink_.link(), loop_,
                               publish_on(control_bus_)),
          out_channel);
}

bool NetemNode::refuses(const Message& message) {
  const bool refused =
      vehicle_senders_.several(message.channel) || control_senders_.several(message.channel);
  if (refused) ++refused_;
  return refused;
}

void NetemNode::watch_position(bool poses_come_up) {
  if (!poses_come_up) {
    subscribe<ground_truth_t>(
        vehicle_bus_, channels_.truth, kDeepQueue, undecodable_positions_,
        [this](const ground_truth_t& truth) { on_position(truth.x_m, truth.y_m); });
    return;
  }
  vehicle_bus_.subscribe(channels_.vehicle_pose, kDeepQueue, [this](const Message& message) {
    if (!wants_position_) return;
    pose_t pose{};
    if (!decode(message.bytes, pose)) {
      ++undecodable_positions_;
      return;
    }
    on_position(pose.x_m, pose.y_m);
  });
}

void NetemNode::on_position(double x_m, double y_m) {
  if (!wants_position_) return;
  if (!std::isfinite(x_m) || !std::isfinite(y_m)) {
    ++undecodable_positions_;
    return;
  }
  for (RunningLink* running : {&uplink_, &downlink_}) {
    running->link().process().on_position(x_m, y_m, loop_.now());
  }
  medium_->on_position(number_on_medium_, x_m, y_m);
}

bool NetemNode::wants_position() const {
  return uplink().process().wants_position() || downlink().process().wants_position() ||
         medium_->wants_position();
}

void NetemNode::finish() {
  uplink_.report();
  downlink_.report();
  counters_.publish_now();
}

void NetemNode::list_counters(CounterList& out) const {
  uplink_.list_counters(out);
  downlink_.list_counters(out);
  for (const CompanionLink& link : beside_) link.list_counters(out);
  if (is_first_) medium_->list_counters(out);
  if (wants_position_) out.emplace_back("undecodable_positions", undecodable_positions_);
  if (preloads_ > 0) out.emplace_back("preloads", preloads_);
  vehicle_senders_.list(out);
  control_senders_.list(out);
  if (refused_ > 0) out.emplace_back("senders.refused", refused_);
  settings_.list_counters(out);
}

std::unique_ptr<NodeGroup<NetemNode>> relays_of(const std::vector<Scenario>& members,
                                                EventLoop& loop, Bus& vehicle_bus,
                                                Bus& control_bus) {
  const Scenario& first = members.front();
  const auto medium = std::make_shared<RunningMedium>(first.get<MediumSettings>(),
                                                      first.get<RunSettings>().seed, loop);
  return group_of<NetemNode>(members, loop, vehicle_bus, control_bus, medium);
}

}  // namespace tether
