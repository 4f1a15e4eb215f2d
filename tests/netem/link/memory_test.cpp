#include <gtest/gtest.h>
#include <malloc.h>

#include <iostream>
#include <memory>
#include <vector>

#include "tests/netem/stages/stage_rig.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::expect_balance;

/// Delays everything by 1 s.
Link delaying_link(const std::string& setting) {
  return test::link_with({setting}, {1.0, std::chrono::seconds{1}});
}

TEST(Link, DropsAndCountsWhatIsTooManyBytesUnderWay) {
  Link link = delaying_link("queue_limit_bytes=1000");
  const auto push = [&link](double t_s, std::size_t bytes) {
    return link.push(at_s(t_s), {"X", std::vector<std::uint8_t>(bytes)}) != Instant::max();
  };
  EXPECT_TRUE(push(0.0, 600));
  EXPECT_FALSE(push(0.1, 401));
  EXPECT_TRUE(push(0.2, 400));
  EXPECT_FALSE(push(0.3, 1));
  EXPECT_TRUE(push(0.4, 0));
  link.pop_ready(at_s(1.0), [](const Packet&) {});
  EXPECT_TRUE(push(1.1, 600));
  EXPECT_EQ(link.counters().overflowed, 2);
  expect_balance(link);
}

/// Bytes that this process has from malloc; 0 where sanitizers stand in for it.
std::size_t allocated_bytes() {
  const auto info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

TEST(Link, AHundredThousandPacketsUnderWayTakeTheMemoryThatTheDocumentsSay) {
  constexpr std::int64_t kPackets = 100'000;
  constexpr std::size_t kPayload = 1000;
  constexpr double kPerPacket =
      300.0;  // docs/explanation/performance.md: 135; more where a vector has just grown
  Link link = delaying_link("queue_limit=" + std::to_string(kPackets));
  const std::size_t before = allocated_bytes();
  for (std::int64_t i = 0; i < kPackets + 500; ++i) {
    link.push(at_ms(0.001 * static_cast<double>(i)),
              {"CTRL/POSE", std::vector<std::uint8_t>(kPayload)});
  }
  const double per_packet =
      static_cast<double>(allocated_bytes() - before) / static_cast<double>(kPackets);
  EXPECT_EQ(link.in_flight(), kPackets);
  EXPECT_EQ(link.counters().overflowed, 500);
  EXPECT_LT(per_packet, kPayload + kPerPacket);
  std::cout << per_packet << " bytes a packet of " << kPayload << "\n";
  expect_balance(link);
}

}  // namespace
}  // namespace tether
