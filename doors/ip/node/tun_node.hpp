#pragma once

#include <cstdint>
#include <fstream>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"
#include "common/scenario/scenario.hpp"
#include "doors/ip/floor_plan.hpp"
#include "netem/relay/netem_node.hpp"
#include "netem/relay/running_link.hpp"

namespace tether::ip {

/// The network between the hosts of a floor: each IP packet passes the links of its vehicle, whole
/// and with its size as it is. From a vehicle to the control room it passes the vehicle's uplink,
/// back the downlink; from a vehicle to another one the uplink of the first and the downlink of the
/// second. A multicast packet passes the links to each other host. With a shared medium, vehicles
/// are its stations and each packet is a frame before it reaches the link.
///
/// The links have the scenario's models, stages and random streams, but their own queues. They
/// report on NET/IP_UPLINK and NET/IP_DOWNLINK of each vehicle, take settings from its NET/SET, and
/// know the vehicle's position from SIM/TRUTH, if a simulator publishes it.
///
/// read = malformed + unroutable + offered, always; a multicast packet counts as offered once.
class TunNode final : public Node {
 public:
  /// Hands a packet to a host; false if its device does not take it (the host is gone, or its queue
  /// is full), which is counted.
  using Write = std::function<bool(std::size_t host, const std::vector<std::uint8_t>& bytes)>;

  /// `members`: of fleet_members(); `plan`: of their names. `record`: a folder for the fate of each
  /// packet of each link, NAME-uplink.csv and NAME-downlink.csv; "": none. Throws UsageError for
  /// medium.serve = "most_valuable", which has no meaning for IP packets, and for a file that
  /// cannot be written.
  TunNode(const std::vector<Scenario>& members, const FloorPlan& plan, const std::string& record,
          EventLoop& loop, Bus& bus, Write write);

  /// A packet from a host's TUN device.
  void take(std::size_t host, std::vector<std::uint8_t> bytes);

  void finish() override;

  void list_counters(CounterList& out) const;
  const Link& uplink(std::size_t vehicle) const { return vehicles_.at(vehicle)->uplink.link(); }
  const Link& downlink(std::size_t vehicle) const { return vehicles_.at(vehicle)->downlink.link(); }

 private:
  struct Vehicle {
    Vehicle(TunNode& node, std::size_t host, const VehicleNetemSettings& settings);

    std::size_t on_medium;
    RunningLink uplink;
    RunningLink downlink;
    RunningMedium::Deliver behind_air_up;
    RunningMedium::Deliver behind_air_down;
    LiveSettings settings;

   private:
    Vehicle(TunNode& node, std::size_t host, const VehicleNetemSettings& settings,
            const ChannelModels& models);
    Vehicle(TunNode& node, std::size_t host, const VehicleNetemSettings& settings,
            const ChannelModels& models, LinkPair links);
  };
  struct Record {
    explicit Record(const std::string& file);
    void add(const PacketFate& fate);
    std::ofstream out;
    Instant last = Instant::min();
  };

  void up(std::size_t vehicle, Packet packet);
  void down(std::size_t vehicle, Packet packet);
  void hand_to(std::size_t host, const Packet& packet);
  void arrived_at_control(std::size_t from_vehicle, const Packet& packet);
  void watch_position(std::size_t vehicle, const std::string& channel);
  void keep_fates(const std::string& folder);

  FloorPlan plan_;
  EventLoop& loop_;
  Bus& bus_;
  Write write_;
  Duration report_period_;
  RunningMedium medium_;
  std::vector<std::unique_ptr<Vehicle>> vehicles_;
  std::list<Record> records_;
  std::int64_t read_ = 0;
  std::int64_t malformed_ = 0;
  std::int64_t unroutable_ = 0;
  std::int64_t not_taken_ = 0;  // by a host's device
  std::int64_t undecodable_positions_ = 0;
  CounterReporter counters_;
};

}  // namespace tether::ip
