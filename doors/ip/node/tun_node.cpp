#include "doors/ip/node/tun_node.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tether/ground_truth_t.hpp>
#include <tether/link_report_t.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/say.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/channel/models.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/relay/make_links.hpp"

namespace tether::ip {
namespace {

/// Packet::destination of a packet for all hosts.
constexpr std::size_t kAll = SIZE_MAX;

const MediumSettings& checked(const MediumSettings& medium) {
  if (medium.serve == ScheduledRules::Serve::most_valuable) {
    throw UsageError(
        "medium.serve = \"most_valuable\" is not supported for IP traffic, because IP "
        "packets have no value: use \"round_robin\" or \"oldest_first\"");
  }
  return medium;
}

/// UDP payload of a datagram as long as the packet: so the medium counts sizes.
int payload_bytes(const Packet& packet) {
  constexpr int kIpAndUdpHeaders = 28;
  return std::max(0, static_cast<int>(packet.bytes.size()) - kIpAndUdpHeaders);
}

std::string net_prefix(const ChannelNames& names) {
  return names.net_set.substr(0, names.net_set.find('/') + 1);
}

}  // namespace

TunNode::Vehicle::Vehicle(TunNode& node, std::size_t host, const VehicleNetemSettings& settings)
    : Vehicle(node, host, settings, make_models(settings)) {}

TunNode::Vehicle::Vehicle(TunNode& node, std::size_t host, const VehicleNetemSettings& settings,
                          const ChannelModels& models)
    : Vehicle(node, host, settings, models, make_links(settings, models)) {}

TunNode::Vehicle::Vehicle(TunNode& node, std::size_t host, const VehicleNetemSettings& settings,
                          const ChannelModels& models, LinkPair links)
    : on_medium(node.medium_.add_vehicle(settings.get<VehicleSettings>().name)),
      uplink(
          "ip_uplink", std::move(links.uplink), node.loop_, node.report_period_,
          [&node, host](const Packet& packet) { node.arrived_at_control(host - 1, packet); },
          [&node, channel = net_prefix(ChannelNames(settings.get<VehicleSettings>().name)) +
                            "IP_UPLINK"](const link_report_t& report) {
            publish(node.bus_, channel, report);
          }),
      downlink(
          "ip_downlink", std::move(links.downlink), node.loop_, node.report_period_,
          [&node, host](const Packet& packet) { node.hand_to(host, packet); },
          [&node, channel = net_prefix(ChannelNames(settings.get<VehicleSettings>().name)) +
                            "IP_DOWNLINK"](const link_report_t& report) {
            publish(node.bus_, channel, report);
          }),
      behind_air_up([this](Packet packet) { uplink.take(std::move(packet)); }),
      behind_air_down([this](Packet packet) { downlink.take(std::move(packet)); }),
      settings(settings, models, kVehicleLinks, {&uplink, &downlink}, node.loop_, {&node.bus_}) {}

TunNode::TunNode(const std::vector<Scenario>& members, const FloorPlan& plan,
                 const std::string& record, EventLoop& loop, Bus& bus, Write write)
    : plan_(plan),
      loop_(loop),
      bus_(bus),
      write_(std::move(write)),
      report_period_(from_seconds(members.front().get<RunSettings>().report_period_s)),
      medium_(checked(members.front().get<MediumSettings>()),
              members.front().get<RunSettings>().seed, loop),
      counters_(loop, bus, "tun",
                ChannelNames(members.front().get<VehicleSettings>().name).net_counters,
                report_period_, [this](CounterList& out) { list_counters(out); }) {
  for (const Scenario& member : members) {
    vehicles_.push_back(std::make_unique<Vehicle>(*this, vehicles_.size() + 1, member));
    watch_position(vehicles_.size() - 1, ChannelNames(member.get<VehicleSettings>().name).truth);
  }
  if (!record.empty()) keep_fates(record);
}

void TunNode::take(std::size_t host, std::vector<std::uint8_t> bytes) {
  ++read_;
  const auto header = read_ip_header(bytes);
  if (!header) {
    ++malformed_;
    return;
  }
  const FloorPlan::Route route = plan_.route(host, header->destination);
  if (route.next == FloorPlan::Next::nowhere) {
    ++unroutable_;
    return;
  }
  const bool for_all = route.next == FloorPlan::Next::all;
  Packet packet{"", std::move(bytes), for_all ? kAll : route.host};
  if (host != FloorPlan::kControl) return up(host - 1, std::move(packet));
  if (!for_all) return down(route.host - 1, std::move(packet));
  for (std::size_t vehicle = 0; vehicle < vehicles_.size(); ++vehicle) down(vehicle, packet);
}

void TunNode::up(std::size_t vehicle, Packet packet) {
  const int bytes = payload_bytes(packet);
  Vehicle& from = *vehicles_[vehicle];
  medium_.send(from.on_medium, Way::up, std::move(packet), bytes, from.behind_air_up);
}

void TunNode::down(std::size_t vehicle, Packet packet) {
  const int bytes = payload_bytes(packet);
  Vehicle& to = *vehicles_[vehicle];
  medium_.send(to.on_medium, Way::down, std::move(packet), bytes, to.behind_air_down);
}

void TunNode::hand_to(std::size_t host, const Packet& packet) {
  if (!write_(host, packet.bytes)) ++not_taken_;
}

void TunNode::arrived_at_control(std::size_t from_vehicle, const Packet& packet) {
  if (packet.destination == FloorPlan::kControl || packet.destination == kAll) {
    hand_to(FloorPlan::kControl, packet);
  }
  for (std::size_t vehicle = 0; vehicle < vehicles_.size(); ++vehicle) {
    const bool is_for = packet.destination == vehicle + 1 ||
                        (packet.destination == kAll && vehicle != from_vehicle);
    if (is_for) down(vehicle, packet);
  }
}

void TunNode::watch_position(std::size_t vehicle, const std::string& channel) {
  subscribe<ground_truth_t>(bus_, channel, kDeepQueue, undecodable_positions_,
                            [this, vehicle](const ground_truth_t& truth) {
                              if (!std::isfinite(truth.x_m) || !std::isfinite(truth.y_m)) {
                                ++undecodable_positions_;
                                return;
                              }
                              Vehicle& of = *vehicles_[vehicle];
                              for (RunningLink* link : {&of.uplink, &of.downlink}) {
                                link->link().process().on_position(truth.x_m, truth.y_m,
                                                                   loop_.now());
                              }
                              medium_.on_position(of.on_medium, truth.x_m, truth.y_m);
                            });
}

TunNode::Record::Record(const std::string& file) : out(file) {
  out << "time_s,lost,delay_ms\n" << std::flush;
  if (!out) throw UsageError(fmt::format("--record: {} cannot be written", file));
}

/// Times of a trace increase strictly.
void TunNode::Record::add(const PacketFate& fate) {
  last = last == Instant::min() ? fate.arrival : std::max(fate.arrival, last + Duration{1});
  const bool lost = fate.departure == Instant::max();
  out << fmt::format("{:.9f},{},", to_seconds(last), lost ? 1 : 0);
  if (!lost) out << fmt::format("{:.6f}", to_milliseconds(fate.departure - fate.arrival));
  out << '\n';
}

void TunNode::keep_fates(const std::string& folder) {
  for (std::size_t vehicle = 0; vehicle < vehicles_.size(); ++vehicle) {
    for (const bool is_up : {true, false}) {
      Record& record = records_.emplace_back(folder + "/" + plan_.name(vehicle + 1) +
                                             (is_up ? "-uplink.csv" : "-downlink.csv"));
      RunningLink& link = is_up ? vehicles_[vehicle]->uplink : vehicles_[vehicle]->downlink;
      link.link().set_observer([&record](const PacketFate& fate) { record.add(fate); });
    }
  }
}

void TunNode::finish() {
  for (const auto& vehicle : vehicles_) {
    vehicle->uplink.report();
    vehicle->downlink.report();
  }
  counters_.publish_now();
  for (Record& record : records_) {
    record.out.flush();
    if (!record.out) {
      say(Severity::error, "tether-tun: --record: not all fates were written: is the disk full?");
    }
  }
}

void TunNode::list_counters(CounterList& out) const {
  out.emplace_back("read", read_);
  out.emplace_back("malformed", malformed_);
  out.emplace_back("unroutable", unroutable_);
  out.emplace_back("not_taken", not_taken_);
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    CounterList of_vehicle;
    vehicles_[i]->uplink.list_counters(of_vehicle);
    vehicles_[i]->downlink.list_counters(of_vehicle);
    vehicles_[i]->settings.list_counters(of_vehicle);
    for (const auto& [name, value] : of_vehicle) {
      out.emplace_back(vehicles_.size() == 1 ? name : plan_.name(i + 1) + "." + name, value);
    }
  }
  medium_.list_counters(out);
  if (undecodable_positions_ > 0) out.emplace_back("undecodable_positions", undecodable_positions_);
}

}  // namespace tether::ip
