#include <fmt/format.h>
#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "netem/medium/contention.hpp"
#include "netem/medium/wifi_airtime.hpp"

namespace tether {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

const WifiPhy kPhy;
const AccessParameters kBestEffort{15, 1023, 3, 7}, kVoice{3, 7, 2, 7};

/// A medium whose frames' ends can be looked up.
struct Rig {
  Rig()
      : medium({.slot = microseconds{9}, .sifs = kPhy.sifs}, 1,
               [this](const FrameEnd& end) { ends[end.id] = end; }) {}
  std::size_t add(int station, const AccessParameters& access, const QueueLimits& limits = {}) {
    return medium.add(station, access, limits,
                      fmt::format("station {} cw {}", station, access.cw_min));
  }
  bool push(Instant now, std::size_t contender, std::uint64_t id, int bytes = 120) {
    Frame frame = unicast_frame(kPhy, bytes, true);
    frame.id = id;
    return medium.push(now, contender, frame);
  }
  bool broadcast(Instant now, std::size_t contender, std::uint64_t id) {
    Frame frame = broadcast_frame(kPhy, 120);
    frame.id = id;
    return medium.push(now, contender, frame);
  }
  std::map<std::uint64_t, FrameEnd> ends;
  Contention medium;
};

TEST(Medium, TakesAFrameAtTheNextSlotWhenItHasBeenIdleForLong) {
  Rig rig;
  const std::size_t agv = rig.add(0, kBestEffort);
  const Instant now = kStart + milliseconds{5} + microseconds{3};
  rig.push(now, agv, 1);
  rig.medium.advance(now + milliseconds{1});
  const Duration delay = rig.ends.at(1).at - now;
  const Duration air = unicast_frame(kPhy, 120, true).air;
  EXPECT_GE(delay, air);
  EXPECT_LT(delay, air + microseconds{9});
}

// 400 draws of 16 values: each has 25, standard deviation 4.8; five of it.
TEST(Medium, DrawsABackoffForAFrameThatComesWhileItIsBusy) {
  std::vector<int> drawn(16);
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    Instant at{};
    Contention medium({.slot = microseconds{9}, .sifs = kPhy.sifs}, seed,
                      [&at](const FrameEnd& end) { at = end.at; });
    const Frame first = unicast_frame(kPhy, 1500, true), second = unicast_frame(kPhy, 120, true);
    const std::size_t a = medium.add(0, kBestEffort, {}, "a");
    const std::size_t b = medium.add(1, kBestEffort, {}, "b");
    medium.push(kStart + milliseconds{1}, a, first);
    const Instant start = medium.next_event();
    medium.advance(start);
    medium.push(start + microseconds{50}, b, second);
    medium.advance(start + milliseconds{10});
    const Instant earliest = start + first.exchange + kPhy.sifs + 3 * microseconds{9};
    ++drawn.at(static_cast<std::size_t>((at - second.air - earliest) / microseconds{9}));
  }
  for (const int n : drawn) EXPECT_NEAR(n, 25, 24);
}

TEST(Medium, LetsNoStationInterruptAFrame) {
  Rig rig;
  const std::size_t a = rig.add(0, kBestEffort), b = rig.add(1, kVoice);
  rig.push(kStart + milliseconds{1}, a, 1, 1500);
  const Instant start = rig.medium.next_event();
  rig.medium.advance(start);
  rig.push(start + microseconds{1}, b, 2);
  rig.medium.advance(start + milliseconds{10});
  EXPECT_GE(rig.ends.at(2).at, start + unicast_frame(kPhy, 1500, true).exchange);
  EXPECT_EQ(rig.medium.counters().collisions, 0);
}

TEST(Medium, DropsAFrameAfterItsLastAttempt) {
  Rig rig;
  const std::size_t agv = rig.add(0, kBestEffort);
  Frame frame = unicast_frame(kPhy, 120, true);
  frame.id = 1;
  frame.error_ratio = 1.0;
  rig.medium.push(kStart, agv, frame);
  rig.medium.advance(kStart + milliseconds{1000});
  EXPECT_FALSE(rig.ends.at(1).delivered);
  EXPECT_EQ(rig.ends.at(1).attempts, 7);
  EXPECT_EQ(rig.medium.counters().corrupted, 7);
}

TEST(Medium, SendsBroadcastsOnce) {
  Rig rig;
  const std::size_t a = rig.add(0, {0, 0, 2, 7}), b = rig.add(1, {0, 0, 2, 7});
  rig.broadcast(kStart, a, 1);
  rig.broadcast(kStart, b, 2);
  rig.medium.advance(kStart + milliseconds{10});
  EXPECT_FALSE(rig.ends.at(1).delivered);
  EXPECT_FALSE(rig.ends.at(2).delivered);
  EXPECT_EQ(rig.medium.counters().attempts, 2);
}

// Equal counters within one station are settled inside it, before anything is in the air.
TEST(Medium, PutsTheMostUrgentOfOneStationIntoTheAir) {
  Rig rig;
  const std::size_t urgent = rig.add(0, {0, 15, 2, 7}), other = rig.add(0, {0, 15, 2, 7});
  rig.broadcast(kStart, urgent, 1);
  rig.broadcast(kStart, other, 2);
  rig.medium.advance(kStart + milliseconds{10});
  EXPECT_TRUE(rig.ends.at(1).delivered);
  EXPECT_TRUE(rig.ends.at(2).delivered);
  EXPECT_LT(rig.ends.at(1).at, rig.ends.at(2).at);
  EXPECT_EQ(rig.medium.counters().collisions, 0);
}

TEST(Medium, DoesNotSendWhatHasWaitedForTooLong) {
  Rig rig;
  const std::size_t agv = rig.add(0, kBestEffort, {.lifetime = milliseconds{1}});
  for (std::uint64_t id = 0; id < 20; ++id) rig.push(kStart, agv, id, 1500);
  rig.medium.advance(kStart + milliseconds{100});
  const Contention::Counters& c = rig.medium.counters();
  EXPECT_GT(c.expired, 0);
  EXPECT_EQ(c.expired + c.delivered, 20);
  for (const auto& [id, end] : rig.ends) {
    EXPECT_TRUE(!end.delivered || end.at < kStart + milliseconds{2});
  }
}

TEST(Medium, AccountsForEveryFrame) {
  Rig rig;
  RandomEngine random(5);
  for (int i = 0; i < 20; ++i) rig.add(i, i % 2 == 0 ? kVoice : kBestEffort, {.frames = 4});
  std::int64_t pushed = 0;
  Instant now = kStart;
  for (std::uint64_t id = 0; id < 20'000; ++id, ++pushed) {
    now += from_seconds(2e-4 * uniform_01(random));
    rig.push(now, static_cast<std::size_t>(20 * uniform_01(random)), id);
  }
  std::int64_t waiting = 0;
  for (std::size_t i = 0; i < 20; ++i) waiting += static_cast<std::int64_t>(rig.medium.waiting(i));
  const Contention::Counters& c = rig.medium.counters();
  EXPECT_EQ(pushed, c.delivered + c.dropped + c.expired + c.overflowed + waiting);
  EXPECT_GT(c.collisions, 0);
  EXPECT_GT(c.overflowed, 0);
}

// A station that is there but silent draws nothing and changes nothing.
TEST(Medium, IsTheSameWithOneMoreWhoIsSilent) {
  const auto ends_of = [](int stations) {
    Rig rig;
    for (int i = 0; i < stations; ++i) rig.add(i, kVoice);
    for (std::uint64_t id = 0; id < 2000; ++id) {
      rig.push(kStart + id * microseconds{100}, id % 5, id);
    }
    rig.medium.advance(kStart + milliseconds{1000});
    std::vector<Instant> ends;
    for (const auto& [id, end] : rig.ends) ends.push_back(end.at);
    return ends;
  };
  EXPECT_EQ(ends_of(5), ends_of(9));
}

}  // namespace
}  // namespace tether
