// Our sockets beside LCM's, in a network of its own: see lcm_bus_test.cpp.
#include "common/lcm/udpm_bus.hpp"

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "common/lcm/lcm_bus.hpp"
#include "common/node/real_time_loop.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Bytes = std::vector<std::uint8_t>;

const std::string kUrl = "udpm://239.255.76.67:7772?ttl=0";

struct UdpmBusTest : ::testing::Test {
  /// Names and lengths of what a bus hears.
  void listen(Bus& bus, std::vector<std::string>& heard, const std::string& pattern = ".*") {
    bus.subscribe(pattern, kDeepQueue, [this, &heard](const Message& m) {
      heard.push_back(std::string(m.channel) + ":" + std::to_string(m.bytes.size()));
      last.assign(m.bytes.begin(), m.bytes.end());
    });
  }
  /// Lives until `done`, which the tests then check; 10 s are for a very busy machine.
  template <class Condition>
  void run_until(Condition done) {
    const Instant end = loop.now() + 10s;
    while (!done() && loop.now() < end) loop.run_until(loop.now() + 2ms);
  }
  static std::int64_t counter(const Bus& bus, const std::string& name) {
    CounterList counters;
    bus.list_counters(counters);
    for (const auto& [key, value] : counters) {
      if (key == name) return value;
    }
    ADD_FAILURE() << name;
    return -1;
  }

  RealTimeLoop loop{RealTimeLoop::wall_utime_us()};
  UdpmBus ours{kUrl, loop};
  LcmBus lcm{kUrl, loop};
  std::vector<std::string> heard;
  Bytes last;
};

TEST_F(UdpmBusTest, AsksItsFilterOnceForEachMessageWithASubscriber) {
  std::vector<std::string> asked, taken;
  UdpmBus filtering(kUrl, loop, [&asked](const Message& m) {
    asked.emplace_back(m.channel);
    EXPECT_NE(m.sender, 0U);
    return m.channel != "AGV/CMD_VEL";
  });
  for (const char* pattern : {"AGV/.*", "AGV/(POSE|CMD_VEL)"}) {
    filtering.subscribe(pattern, 1, [&taken](const Message& m) { taken.emplace_back(m.channel); });
  }
  for (const char* channel : {"OTHER", "AGV/CMD_VEL", "AGV/POSE"}) lcm.publish(channel, Bytes{1});
  run_until([&] { return taken.size() >= 2; });
  EXPECT_THAT(asked, ElementsAre("AGV/CMD_VEL", "AGV/POSE"));
  EXPECT_THAT(taken, ElementsAre("AGV/POSE", "AGV/POSE"));
  EXPECT_EQ(counter(filtering, "refused"), 1);
}

TEST_F(UdpmBusTest, HearsLcmInOrder) {
  listen(ours, heard);
  std::vector<std::string> sent;
  for (std::size_t i = 0; i < 100; ++i) {
    lcm.publish("AGV/POSE", Bytes(i, 7));
    sent.push_back("AGV/POSE:" + std::to_string(i));
  }
  run_until([&] { return heard.size() >= sent.size(); });
  EXPECT_EQ(heard, sent);
}

TEST_F(UdpmBusTest, IsHeardByLcmAndByOthersOfItsKind) {
  UdpmBus another(kUrl, loop);
  std::vector<std::string> by_another;
  listen(lcm, heard);
  listen(another, by_another);
  ours.publish("A", Bytes(3));
  ours.publish("B", {});
  run_until([&] { return heard.size() >= 2 && by_another.size() >= 2; });
  EXPECT_THAT(heard, ElementsAre("A:3", "B:0"));
  EXPECT_THAT(by_another, ElementsAre("A:3", "B:0"));
}

TEST_F(UdpmBusTest, MessagesOf300KilobytesPassBothWays) {
  Bytes bytes(300'000);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(i * i >> 3);
  listen(ours, heard);
  lcm.publish("BIG", bytes);
  run_until([&] { return !heard.empty(); });
  EXPECT_THAT(heard, ElementsAre("BIG:300000"));
  EXPECT_EQ(last, bytes);

  std::vector<std::string> by_lcm;
  listen(lcm, by_lcm);
  last.clear();
  ours.publish("BIG", bytes);
  run_until([&] { return !by_lcm.empty(); });
  EXPECT_THAT(by_lcm, ElementsAre("BIG:300000"));
  EXPECT_EQ(last, bytes);
}

TEST_F(UdpmBusTest, NeverHearsItselfAndCountsWhatItDidNotHear) {
  listen(ours, heard);
  for (int i = 0; i < 10; ++i) ours.publish("A", Bytes(3));
  lcm.publish("B", Bytes(1));
  run_until([&] { return !heard.empty(); });
  EXPECT_THAT(heard, ElementsAre("B:1"));
  EXPECT_EQ(counter(ours, "datagrams_own"), 10);
}

TEST_F(UdpmBusTest, APatternMustMatchTheWholeName) {
  listen(ours, heard, "A|BC");
  for (const char* channel : {"AB", "A", "ABC", "BC"}) lcm.publish(channel, {});
  run_until([&] { return heard.size() >= 2; });
  EXPECT_THAT(heard, ElementsAre("A:0", "BC:0"));
}

TEST_F(UdpmBusTest, LcmTestingItselfIsNotTraffic) {
  listen(ours, heard);
  std::vector<std::string> by_lcm;
  listen(lcm, by_lcm);  // LCM now tests itself
  lcm.publish("A", {});
  run_until([&] { return !heard.empty(); });
  EXPECT_THAT(heard, ElementsAre("A:0"));
}

TEST_F(UdpmBusTest, AnotherGroupOnTheSamePortIsNotHeard) {
  UdpmBus other("udpm://239.255.76.68:7772?ttl=0", loop);
  listen(ours, heard);
  other.publish("X", {});
  lcm.publish("A", {});
  run_until([&] { return !heard.empty(); });
  EXPECT_THAT(heard, ElementsAre("A:0"));
}

TEST_F(UdpmBusTest, WhatTheKernelsBufferHasNoRoomForIsCounted) {
  listen(ours, heard);
  constexpr int kCount = 20'000;
  for (int i = 0; i < kCount; ++i) lcm.publish("A", Bytes(100));
  run_until([&] {
    return static_cast<std::int64_t>(heard.size()) + counter(ours, "datagrams_dropped") >= kCount;
  });
  EXPECT_GT(counter(ours, "datagrams_dropped"), 0);
  EXPECT_EQ(static_cast<std::int64_t>(heard.size()) + counter(ours, "datagrams_dropped"), kCount);
}

TEST_F(UdpmBusTest, ANameThatIsTooLongIsCountedAsAFailure) {
  ours.publish(std::string(64, 'n'), {});
  EXPECT_EQ(counter(ours, "publish_failures"), 1);
}

TEST_F(UdpmBusTest, ReceivesNothingWithoutSubscribers) {
  lcm.publish("A", {});
  loop.run_until(loop.now() + 20ms);
  EXPECT_EQ(counter(ours, "datagrams_own"), 0);
  EXPECT_THAT(heard, IsEmpty());
}

}  // namespace
}  // namespace tether
