#include "doors/ip/floor_plan.hpp"

#include <gmock/gmock.h>

#include "common/base/errors.hpp"

namespace tether::ip {
namespace {

std::vector<std::uint8_t> packet_of(std::size_t bytes) {
  std::vector<std::uint8_t> packet(bytes);
  packet[0] = 0x45;
  packet[2] = static_cast<std::uint8_t>(bytes / 256);
  packet[3] = static_cast<std::uint8_t>(bytes % 256);
  packet[12] = packet[16] = 10;
  packet[15] = 1;
  packet[19] = 2;
  return packet;
}

TEST(IpHeader, HasTheAddressesOfAPacket) {
  const auto header = read_ip_header(packet_of(1500));
  ASSERT_TRUE(header);
  EXPECT_EQ(to_text(header->source), "10.0.0.1");
  EXPECT_EQ(to_text(header->destination), "10.0.0.2");
}

TEST(IpHeader, RefusesWhatIsNotExactlyOneIpv4Packet) {
  auto other_version = packet_of(40);
  other_version[0] = 0x65;
  auto short_header = packet_of(40);
  short_header[0] = 0x44;
  auto header_beyond_end = packet_of(40);
  header_beyond_end[0] = 0x4f;
  auto cut = packet_of(40);
  cut.pop_back();
  auto longer = packet_of(40);
  longer.push_back(0);
  for (const auto& packet : {other_version, short_header, header_beyond_end, cut, longer,
                             std::vector<std::uint8_t>{}, std::vector<std::uint8_t>(19, 0x45)}) {
    EXPECT_FALSE(read_ip_header(packet));
  }
  EXPECT_TRUE(read_ip_header(packet_of(20)));
}

TEST(FloorPlan, GivesEachOfAThousandVehiclesAnAddressOfItsOwn) {
  std::vector<std::string> names;
  for (int i = 1; i <= 1000; ++i) names.push_back("AGV" + std::to_string(i));
  const FloorPlan plan(names);
  for (std::size_t host = 0; host < plan.size(); ++host) {
    const auto route = plan.route(host == 0 ? 1 : 0, FloorPlan::address(host));
    ASSERT_EQ(route.next, FloorPlan::Next::one);
    ASSERT_EQ(route.host, host);
  }
  EXPECT_EQ(to_text(FloorPlan::address(0)), "10.67.0.1");
  EXPECT_EQ(to_text(FloorPlan::address(1)), "10.67.1.1");
  EXPECT_EQ(to_text(FloorPlan::address(255)), "10.67.2.1");
}

TEST(FloorPlan, SendsMulticastAndBroadcastToAllAndUnknownAddressesNowhere) {
  const FloorPlan plan({"AGV"});
  const Address multicast = 0xe0000001U, broadcast = 0x0a43ffffU, unknown = 0x0a430202U;
  EXPECT_EQ(plan.route(0, multicast).next, FloorPlan::Next::all);
  EXPECT_EQ(plan.route(1, broadcast).next, FloorPlan::Next::all);
  EXPECT_EQ(plan.route(0, unknown).next, FloorPlan::Next::nowhere);
  EXPECT_EQ(plan.route(1, FloorPlan::address(1)).next, FloorPlan::Next::nowhere);
}

TEST(FloorPlan, RefusesNamesThatCannotBeHosts) {
  for (const std::string name : {"", "a b", "x\n127.0.0.1 y", "-x", "Control", "ä"}) {
    EXPECT_THROW(FloorPlan({name}), UsageError) << name;
  }
  EXPECT_THROW(FloorPlan({"AGV", "agv"}), UsageError);
}

}  // namespace
}  // namespace tether::ip
