#include "doors/ip/node/tun_node.hpp"

#include <gmock/gmock.h>

#include <map>
#include <sstream>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/node/in_process_bus.hpp"
#include "common/node/virtual_loop.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/models/trace.hpp"
#include "tests/support/folder.hpp"

namespace tether::ip {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// A floor in virtual time. Packets carry their number in the identification field.
class FloorOf {
 public:
  explicit FloorOf(const std::vector<std::string>& overrides, const std::string& record = "")
      : members(fleet_members(parse_scenario("", "test.toml", overrides))), bus(loop) {
    std::vector<std::string> names;
    for (const Scenario& member : members) names.push_back(member.get<VehicleSettings>().name);
    node = std::make_unique<TunNode>(
        members, FloorPlan(names), record, loop, bus,
        [this](std::size_t host, const std::vector<std::uint8_t>& packet) {
          if (host == full) return false;
          got[host].push_back(packet[4] * 256 + packet[5]);
          when.push_back(loop.now());
          return true;
        });
  }

  void send(Instant at, std::size_t host, Address to, int number, std::size_t bytes = 100) {
    std::vector<std::uint8_t> packet(bytes);
    packet[0] = 0x45;
    packet[2] = static_cast<std::uint8_t>(bytes / 256);
    packet[3] = static_cast<std::uint8_t>(bytes % 256);
    packet[4] = static_cast<std::uint8_t>(number / 256);
    packet[5] = static_cast<std::uint8_t>(number % 256);
    for (std::size_t i = 0; i < 4; ++i) {
      packet[16 + i] = static_cast<std::uint8_t>(to >> (24 - 8 * i));
    }
    loop.at(at, Priority::node, [=, this](Instant) { node->take(host, packet); });
  }
  void run() { loop.run_until(kStart + std::chrono::seconds{60}); }
  std::int64_t counter(const std::string& name) const {
    CounterList list;
    node->list_counters(list);
    for (const auto& [key, value] : list) {
      if (key == name) return value;
    }
    return -1;
  }

  VirtualLoop loop;
  std::vector<Scenario> members;
  InProcessBus bus;
  std::unique_ptr<TunNode> node;
  std::size_t full = 99;  // the host whose device takes nothing
  std::map<std::size_t, std::vector<int>> got;
  std::vector<Instant> when;
};

Instant at_ms(int ms) { return kStart + std::chrono::milliseconds{ms}; }

TEST(TunNode, DelaysPacketsOfEachWayByItsOwnLink) {
  FloorOf floor({"channel.uplink.delay_ms=30", "channel.downlink.delay_ms=5"});
  floor.send(at_ms(100), 1, FloorPlan::address(0), 1);
  floor.send(at_ms(200), 0, FloorPlan::address(1), 2);
  floor.run();
  EXPECT_THAT(floor.got[0], ElementsAre(1));
  EXPECT_THAT(floor.got[1], ElementsAre(2));
  EXPECT_THAT(floor.when, ElementsAre(at_ms(130), at_ms(205)));
}

TEST(TunNode, CarriesPacketsBetweenVehiclesUpAndDownAgain) {
  FloorOf floor({"fleet.count=3", "channel.uplink.delay_ms=30", "channel.downlink.delay_ms=5",
                 "fleet.offset_x_m=50", "world.half_extent_m=200"});
  floor.send(at_ms(100), 1, FloorPlan::address(3), 7);
  floor.run();
  EXPECT_THAT(floor.got[3], ElementsAre(7));
  EXPECT_THAT(floor.got[0], IsEmpty());
  EXPECT_THAT(floor.got[2], IsEmpty());
  EXPECT_THAT(floor.when, ElementsAre(at_ms(135)));
}

TEST(TunNode, CarriesMulticastToEachOtherHostOnce) {
  FloorOf floor({"fleet.count=3", "fleet.offset_x_m=50", "world.half_extent_m=200"});
  floor.send(at_ms(100), 2, 0xe0000001U, 1);
  floor.send(at_ms(200), 0, 0xe0000001U, 2);
  floor.run();
  EXPECT_THAT(floor.got[0], ElementsAre(1));
  EXPECT_THAT(floor.got[1], ElementsAre(1, 2));
  EXPECT_THAT(floor.got[2], ElementsAre(2));
  EXPECT_THAT(floor.got[3], ElementsAre(1, 2));
}

TEST(TunNode, CountsEachPacketThatItReads) {
  FloorOf floor({"channel.prr=0.5"});
  for (int i = 0; i < 1000; ++i) floor.send(at_ms(i), 1, FloorPlan::address(0), i);
  floor.send(at_ms(5), 1, 0x01010101U, 1);
  floor.loop.at(at_ms(6), Priority::node, [&](Instant) { floor.node->take(1, {0x60, 0, 0}); });
  floor.run();
  EXPECT_EQ(floor.counter("read"), 1002);
  EXPECT_EQ(floor.counter("malformed"), 1);
  EXPECT_EQ(floor.counter("unroutable"), 1);
  EXPECT_EQ(floor.counter("ip_uplink.offered"), 1000);
  const auto delivered = static_cast<double>(floor.counter("ip_uplink.delivered"));
  // 5 standard deviations of a binomial: 5 √(1000/4) = 79.
  EXPECT_NEAR(delivered, 500.0, 79.0);
  EXPECT_EQ(floor.got[0].size(), static_cast<std::size_t>(delivered));
}

TEST(TunNode, CountsPacketsThatAHostsDeviceDoesNotTake) {
  FloorOf floor({"fleet.count=2", "fleet.offset_x_m=50", "world.half_extent_m=200"});
  floor.full = 2;
  floor.send(at_ms(100), 0, FloorPlan::address(2), 1);
  floor.send(at_ms(200), 1, 0xe0000001U, 2);
  floor.run();
  EXPECT_THAT(floor.got[0], ElementsAre(2));
  EXPECT_EQ(floor.counter("not_taken"), 2);
}

TEST(TunNode, IsAStationOfTheSharedMediumWithFramesOfThePacketsSize) {
  const std::vector<std::string> wifi{"medium.model=dcf"};
  FloorOf small(wifi), large(wifi);
  small.send(at_ms(100), 1, FloorPlan::address(0), 1, 100);
  large.send(at_ms(100), 1, FloorPlan::address(0), 1, 1500);
  small.run();
  large.run();
  ASSERT_EQ(small.when.size(), 1U);
  ASSERT_EQ(large.when.size(), 1U);
  EXPECT_GT(small.when[0], at_ms(100));
  // 1400 bytes more at no more than 1 Gbit/s.
  EXPECT_GT(large.when[0] - small.when[0], std::chrono::microseconds{11});
}

TEST(TunNode, RecordsFatesThatTheTraceModelReplays) {
  const test::Folder folder;
  {
    FloorOf floor({"channel.prr=0.7", "channel.uplink.delay_ms=12"}, folder.path.string());
    for (int i = 0; i < 200; ++i) floor.send(at_ms(i), 1, FloorPlan::address(0), i);
    floor.run();
    floor.node->finish();
    const auto trace = load_trace((folder.path / "AGV-uplink.csv").string());
    ASSERT_EQ(trace.rows.size(), 200U);
    EXPECT_TRUE(trace.of_fates);
    std::vector<int> delivered;
    for (int i = 0; i < 200; ++i) {
      const auto& row = trace.rows[static_cast<std::size_t>(i)];
      if (row.prr > 0.0) delivered.push_back(i);
    }
    EXPECT_EQ(delivered, floor.got[0]);
  }
}

TEST(TunNode, RefusesAMediumThatServesByValue) {
  EXPECT_THROW(FloorOf({"medium.model=scheduled", "medium.serve=most_valuable"}), UsageError);
}

}  // namespace
}  // namespace tether::ip
