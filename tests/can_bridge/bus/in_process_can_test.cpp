#include "can_bridge/bus/in_process_can.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "common/node/virtual_loop.hpp"

namespace tether {
namespace {

using std::chrono::microseconds;

const CanFilter kEverything{0, 0};

/// A bus at 500 kbit/s with three ports, and what the third hears.
struct Bus {
  VirtualLoop loop;
  InProcessCan can{loop, 500e3};
  InProcessCan::Port& a = can.add_port();
  InProcessCan::Port& b = can.add_port();
  InProcessCan::Port& listener = can.add_port();
  std::vector<std::pair<std::uint32_t, Instant>> heard;

  Bus() {
    listener.on_frame({kEverything},
                      [this](const CanFrame& f) { heard.emplace_back(f.id, loop.now()); });
  }
  void run(Duration time) { loop.run_until(loop.now() + time); }
};

TEST(InProcessCan, AFrameArrivesWhenItsLastBitIsOver) {
  Bus bus;
  ASSERT_TRUE(bus.a.send(CanFrame::make(0x201, {1, 2, 3, 4, 5, 6})));
  bus.run(microseconds{229});
  EXPECT_TRUE(bus.heard.empty());
  bus.run(microseconds{1});  // 55 + 60 bits of 2 us
  ASSERT_EQ(bus.heard.size(), 1u);
  EXPECT_EQ(bus.heard[0], std::make_pair(0x201u, kStart + microseconds{230}));
}

TEST(InProcessCan, TheLowestIdentifierThatWaitsGoesFirst) {
  Bus bus;
  bus.a.send(CanFrame::make(0x700, {}));  // has the bus already
  bus.a.send(CanFrame::make(0x500, {}));
  bus.b.send(CanFrame::make(0x080, {}));
  bus.run(microseconds{330});
  ASSERT_EQ(bus.heard.size(), 3u);
  EXPECT_EQ(bus.heard[0].first, 0x700u);
  EXPECT_EQ(bus.heard[1].first, 0x080u);
  EXPECT_EQ(bus.heard[2].first, 0x500u);
  EXPECT_EQ(bus.heard[2].second, kStart + microseconds{330});
}

TEST(InProcessCan, TheTapHearsEveryFrameOnce) {
  Bus bus;
  std::vector<std::uint32_t> tapped;
  bus.can.on_any_frame([&tapped](const CanFrame& f) { tapped.push_back(f.id); });
  bus.a.send(CanFrame::make(0x1, {}));
  bus.listener.send(CanFrame::make(0x2, {}));
  bus.run(std::chrono::milliseconds{1});
  EXPECT_EQ(tapped, (std::vector<std::uint32_t>{0x1, 0x2}));
}

TEST(InProcessCan, NoPortHearsItself) {
  Bus bus;
  int own = 0;
  bus.a.on_frame({kEverything}, [&own](const CanFrame&) { ++own; });
  bus.a.send(CanFrame::make(0x1, {}));
  bus.run(std::chrono::milliseconds{1});
  EXPECT_EQ(own, 0);
  EXPECT_EQ(bus.heard.size(), 1u);
}

TEST(InProcessCan, FiltersPassOnlyElevenBitDataFrames) {
  VirtualLoop loop;
  InProcessCan can(loop, 500e3);
  auto& sender = can.add_port();
  auto& receiver = can.add_port();
  std::vector<std::uint32_t> heard;
  receiver.on_frame({{0x181, 0x7FF}, {0x700, 0x780}},
                    [&heard](const CanFrame& f) { heard.push_back(f.id); });
  CanFrame extended = CanFrame::make(0x181, {});
  extended.extended = true;
  CanFrame remote = CanFrame::make(0x181, {});
  remote.remote = true;
  for (const CanFrame& f : {CanFrame::make(0x181, {}), CanFrame::make(0x182, {}),
                            CanFrame::make(0x701, {}), extended, remote}) {
    sender.send(f);
    loop.run_until(loop.now() + std::chrono::milliseconds{1});
  }
  EXPECT_EQ(heard, (std::vector<std::uint32_t>{0x181, 0x701}));
}

CanFrame long_frame(std::uint32_t id, std::span<const std::uint8_t> bytes = {}) {
  CanFrame frame = CanFrame::make(id, bytes);
  frame.extended = true;
  return frame;
}

TEST(InProcessCan, AFilterForLongIdentifiersPassesThoseAlone) {
  Bus bus;
  std::vector<std::uint32_t> heard;
  bus.listener.on_frame({{0x0CEF1000, 0x1FFFFF00, true}},
                        [&heard](const CanFrame& f) { heard.push_back(f.id); });
  CanFrame remote = long_frame(0x0CEF1002);
  remote.remote = true;
  for (const CanFrame& f : {long_frame(0x0CEF1001), long_frame(0x0CEF1101), remote,
                            CanFrame::make(0x000, {}), long_frame(0x0CEF10FF)}) {
    bus.a.send(f);
    bus.run(std::chrono::milliseconds{1});
  }
  EXPECT_EQ(heard, (std::vector<std::uint32_t>{0x0CEF1001, 0x0CEF10FF}));
}

TEST(InProcessCan, OfFramesWithEqualBeginningsTheShortIdentifierGoesFirst) {
  Bus bus;
  std::vector<std::uint32_t> order;
  bus.can.on_any_frame([&order](const CanFrame& f) { order.push_back(f.id); });
  bus.listener.on_frame({}, [](const CanFrame&) {});
  constexpr std::uint32_t kLong = 0x123U << 18;  // its first 11 bits are 0x123
  bus.a.send(CanFrame::make(0x7FF, {}));         // has the bus already
  bus.a.send(long_frame(kLong));
  bus.b.send(CanFrame::make(0x123, {}));
  bus.run(std::chrono::milliseconds{2});
  EXPECT_EQ(order, (std::vector<std::uint32_t>{0x7FF, 0x123, kLong}));
  order.clear();
  bus.a.send(CanFrame::make(0x7FF, {}));
  bus.a.send(CanFrame::make(0x124, {}));
  bus.b.send(long_frame(kLong | 5));
  bus.listener.send(long_frame(kLong | 3));
  bus.run(std::chrono::milliseconds{2});
  EXPECT_EQ(order, (std::vector<std::uint32_t>{0x7FF, kLong | 3, kLong | 5, 0x124}));
}

TEST(InProcessCan, ALongIdentifierTakes25BitsMore) {
  Bus bus;
  bus.a.send(long_frame(0x1FFFFFFF, std::array<std::uint8_t, 1>{}));
  bus.run(microseconds{1800});  // 80 + 10 bits of 2 us
  EXPECT_NEAR(bus.can.load(kStart), 0.1, 1e-9);
}

TEST(InProcessCan, WhatDoesNotFitTheShortQueueIsDroppedAndCounted) {
  Bus bus;
  bus.a.set_state(CanState::stalled);
  for (std::size_t i = 0; i < InProcessCan::kQueueFrames; ++i) {
    EXPECT_TRUE(bus.a.send(CanFrame::make(0x201, {})));
  }
  EXPECT_FALSE(bus.a.send(CanFrame::make(0x201, {})));
  CounterList counters;
  bus.a.list(counters);
  EXPECT_EQ(counters[2], std::make_pair(std::string("can.send_dropped"), std::int64_t{1}));
}

TEST(InProcessCan, ARestartOfAStalledPortSendsNothingOld) {
  Bus bus;
  bus.a.set_state(CanState::stalled);
  bus.a.send(CanFrame::make(0x201, {}));
  std::string why;
  EXPECT_TRUE(bus.a.restart(why));
  bus.run(std::chrono::milliseconds{10});
  EXPECT_TRUE(bus.heard.empty());
  EXPECT_EQ(bus.a.state(), CanState::up);
}

TEST(InProcessCan, APortThatIsBusOffNeitherSendsNorHears) {
  Bus bus;
  bus.listener.set_state(CanState::bus_off);
  EXPECT_FALSE(bus.listener.send(CanFrame::make(0x1, {})));
  bus.a.send(CanFrame::make(0x201, {}));
  bus.run(std::chrono::milliseconds{1});
  EXPECT_TRUE(bus.heard.empty());
}

TEST(InProcessCan, EachChangeOfStateIsReportedOnce) {
  Bus bus;
  std::vector<CanState> seen;
  bus.a.on_state([&seen](CanState s) { seen.push_back(s); });
  bus.a.set_state(CanState::down);
  bus.a.set_state(CanState::down);
  bus.a.set_state(CanState::up);
  EXPECT_EQ(seen, (std::vector<CanState>{CanState::down, CanState::up}));
  std::string why;
  bus.a.set_state(CanState::absent);
  EXPECT_FALSE(bus.a.restart(why));
  EXPECT_EQ(why, "the interface is absent");
}

TEST(InProcessCan, TheLowestIdentifierGoesFirst) {
  Bus bus;
  bus.b.send(CanFrame::make(0x700, {}));
  bus.b.send(CanFrame::make(0x500, {}));
  bus.a.send(CanFrame::make(0x080, {}));
  bus.run(microseconds{330});
  ASSERT_EQ(bus.heard.size(), 3u);
  EXPECT_EQ(bus.heard[1].first, 0x080u);
}

TEST(InProcessCan, WhatWaitsInAPortThatGoesAwayIsNeverSent) {
  for (const CanState away : {CanState::down, CanState::absent}) {
    Bus bus;
    bus.b.send(CanFrame::make(0x1, {}));  // has the bus
    bus.a.send(CanFrame::make(0x201, {}));
    bus.a.set_state(away);
    std::string why;
    EXPECT_FALSE(bus.a.restart(why));
    bus.a.set_state(CanState::up);
    bus.run(std::chrono::milliseconds{1});
    ASSERT_EQ(bus.heard.size(), 1u);
    EXPECT_EQ(bus.heard[0].first, 0x1u);
  }
}

TEST(InProcessCan, WhatWaitsInAStalledPortIsSentWhenItWorksAgain) {
  Bus bus;
  bus.a.set_state(CanState::stalled);
  bus.a.send(CanFrame::make(0x201, {}));
  bus.run(std::chrono::milliseconds{1});
  EXPECT_TRUE(bus.heard.empty());
  bus.a.set_state(CanState::up);
  bus.run(std::chrono::milliseconds{1});
  EXPECT_EQ(bus.heard.size(), 1u);
}

TEST(InProcessCan, CountsWhatItSendsAndHears) {
  Bus bus;
  bus.a.send(CanFrame::make(0x201, {}));
  bus.run(std::chrono::milliseconds{1});
  bus.a.set_state(CanState::bus_off);
  CounterList sender, listener;
  bus.a.list(sender);
  bus.listener.list(listener);
  EXPECT_EQ(sender[0], std::make_pair(std::string("can.sent"), std::int64_t{1}));
  EXPECT_EQ(sender[3], std::make_pair(std::string("can.state_changes"), std::int64_t{1}));
  EXPECT_EQ(listener[1], std::make_pair(std::string("can.received"), std::int64_t{1}));
}

TEST(InProcessCan, ARemoteFrameTakesNoTimeForDataAndNoTimeIsNoLoad) {
  Bus bus;
  EXPECT_EQ(bus.can.load(kStart), 0.0);
  CanFrame remote = CanFrame::make(0x201, {1, 2, 3, 4, 5, 6, 7, 8});
  remote.remote = true;
  bus.a.send(remote);
  bus.run(microseconds{1100});
  EXPECT_NEAR(bus.can.load(kStart), 0.1, 1e-9);
}

TEST(InProcessCan, TheLoadIsTheShareOfTimeThatTheBusIsBusy) {
  Bus bus;
  bus.a.send(CanFrame::make(0x201, {1, 2, 3, 4, 5, 6, 7, 8}));  // 270 us
  bus.run(microseconds{2700});
  EXPECT_NEAR(bus.can.load(kStart), 0.1, 1e-9);
}

}  // namespace
}  // namespace tether
