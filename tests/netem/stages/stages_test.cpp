#include <gmock/gmock.h>

#include <bit>
#include <cmath>
#include <vector>

#include "tests/netem/stages/stage_rig.hpp"
#include "tests/support/virtual_world.hpp"

// Effect of each stage of a link on packets. Tolerances of samples: 5 standard deviations.

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::expect_balance;
using test::link_with;
using test::pop;
using ::testing::ElementsAre;

constexpr double kStageSigmas = 5.0;

using Settings = std::vector<std::string>;

Packet packet_of(std::size_t bytes, std::uint8_t value = 0) {
  return {"X", std::vector<std::uint8_t>(bytes, value)};
}

double ms(Instant t) { return t == Instant::max() ? -1.0 : to_milliseconds(t - kStart); }

void expect_share(double count, double of, double share) {
  EXPECT_NEAR(count / of, share, kStageSigmas * std::sqrt(share * (1.0 - share) / of));
}

// -------------------------------------------------------------------- outages

TEST(LinkOutages, LastFromTheirBeginningUntilJustBeforeTheirEnd) {
  Link link = link_with({"outages=[[1, 2], [2, 2.5], [7, 8]]"});
  const Duration tick{1};
  const std::pair<Instant, bool> expected[] = {{at_s(-5), true},        {at_s(1) - tick, true},
                                               {at_s(1), false},        {at_s(2) - tick, false},
                                               {at_s(2), false},        {at_s(2.5) - tick, false},
                                               {at_s(2.5), true},       {at_s(7) - tick, true},
                                               {at_s(8) - tick, false}, {at_s(8), true}};
  for (const auto& [when, passes] : expected) {
    EXPECT_EQ(link.push(when, packet_of(1)) == when, passes) << to_seconds(when);
  }
  EXPECT_EQ(link.counters().outage_dropped, 5);
  EXPECT_EQ(link.counters().lost, 0);
  expect_balance(link);
}

TEST(LinkOutages, LetPacketsThatAreUnderWayArrive) {
  Link link = link_with({"outages=[[1, 2]]"}, {1.0, std::chrono::seconds{1}});
  link.push(at_s(0.5), packet_of(1, 7));
  EXPECT_THAT(pop(link, at_s(1.5)), ElementsAre(7));
}

// -------------------------------------------------------------------- independent loss

TEST(LinkLoss, IsIndependentOfTheStatesLoss) {
  Link link = link_with({"loss=0.2"}, {0.7, Duration{0}});
  constexpr int kPackets = 200'000;
  for (int i = 0; i < kPackets; ++i) {
    link.push(kStart, packet_of(1));
    pop(link, kStart);
  }
  expect_share(static_cast<double>(link.counters().delivered), kPackets, 0.7 * 0.8);
  expect_balance(link);
}

// -------------------------------------------------------------------- corruption

TEST(LinkCorruption, FlipsExactlySoManyBitsInTheShareOfPackets) {
  Link link = link_with({"corrupt.probability=0.3", "corrupt.bits=3"});
  constexpr int kPackets = 50'000, kBytes = 11;
  double damaged = 0.0, flips[8 * kBytes] = {};
  for (int i = 0; i < kPackets; ++i) {
    link.push(kStart, packet_of(kBytes));
    link.pop_ready(kStart, [&](const Packet& p) {
      int bits = 0;
      for (std::size_t bit = 0; bit < 8 * kBytes; ++bit) {
        const bool set = (p.bytes[bit / 8] >> (bit % 8) & 1) != 0;
        bits += set ? 1 : 0;
        flips[bit] += set ? 1.0 : 0.0;
      }
      EXPECT_TRUE(bits == 0 || bits == 3) << bits;
      damaged += bits > 0 ? 1.0 : 0.0;
    });
  }
  expect_share(damaged, kPackets, 0.3);
  EXPECT_EQ(static_cast<double>(link.counters().corrupted), damaged);
  for (const double count : flips) expect_share(count, damaged, 3.0 / (8 * kBytes));
}

TEST(LinkCorruption, OfAShortPacketFlipsAllItsBitsAndOfAnEmptyOneNone) {
  Link link = link_with({"corrupt.probability=1", "corrupt.bits=9"});
  link.push(kStart, packet_of(1, 0x0f));
  EXPECT_THAT(pop(link, kStart), ElementsAre(0xf0));
  link.push(kStart, packet_of(0));
  EXPECT_EQ(link.counters().corrupted, 1);
}

// -------------------------------------------------------------------- duplication

TEST(LinkDuplication, SendsTheShareTwiceAndCountsCopies) {
  Link link = link_with({"duplicate.probability=0.25"}, {0.5, std::chrono::milliseconds{5}});
  constexpr int kPackets = 100'000;
  std::size_t delivered = 0, announced = 0;
  for (int i = 0; i < kPackets; ++i) {
    const Instant now = at_ms(10.0 * i);
    const Instant leaves = link.push(now, packet_of(1));
    announced += leaves != Instant::max() ? 1U : 0U;
    announced += link.copy_departure() != Instant::max() ? 1U : 0U;
    EXPECT_TRUE(leaves != Instant::max() || link.copy_departure() == Instant::max())
        << "a copy of a lost packet";
    delivered += pop(link, now + std::chrono::milliseconds{5}).size();
  }
  EXPECT_EQ(delivered, announced);
  const Link::Counters& c = link.counters();
  expect_share(static_cast<double>(c.duplicated), static_cast<double>(c.offered - c.lost), 0.25);
  expect_balance(link);
}

TEST(LinkDuplication, ACopyHasAJitterOfItsOwnAndTheSameBytes) {
  Link link = link_with(
      {"duplicate.probability=1", "jitter.law=uniform", "jitter.mean_ms=10", "jitter.sd_ms=2"});
  int earlier = 0;
  for (int i = 0; i < 1000; ++i) {
    const Instant leaves = link.push(at_s(i), packet_of(1, 9));
    EXPECT_NE(leaves, link.copy_departure());
    earlier += link.copy_departure() < leaves ? 1 : 0;
    EXPECT_THAT(pop(link, at_s(i + 1)), ElementsAre(9, 9));
  }
  expect_share(earlier, 1000, 0.5);
}

// -------------------------------------------------------------------- rate

constexpr const char* kByteAMillisecond = "rate.bits_per_s=8e3";

TEST(LinkRate, PacketsFollowEachOtherAtExactlyTheRate) {
  Link link = link_with({"rate.bits_per_s=1e6", "rate.overhead_bytes=25"},
                        {1.0, std::chrono::milliseconds{40}});
  // (100 + 25)·8 bits take 1 ms, (225 + 25)·8 take 2 ms.
  EXPECT_EQ(ms(link.push(at_ms(0), packet_of(100))), 41.0);
  EXPECT_EQ(ms(link.push(at_ms(0), packet_of(225))), 43.0);
  EXPECT_EQ(ms(link.push(at_ms(2.5), packet_of(100))), 44.0);   // still behind the second
  EXPECT_EQ(ms(link.push(at_ms(4.0), packet_of(100))), 45.0);   // free since this instant
  EXPECT_EQ(ms(link.push(at_ms(10.0), packet_of(100))), 51.0);  // was idle
}

TEST(LinkRate, AFullQueueOfPacketsDropsTheTail) {
  Link link = link_with({kByteAMillisecond, "rate.queue_packets=3"});
  std::vector<double> leaves;
  for (const double t : {0.0, 0.0, 0.0, 0.0, 9.999999, 10.0, 10.0}) {
    leaves.push_back(ms(link.push(at_ms(t), packet_of(10))));
  }
  EXPECT_THAT(leaves, ElementsAre(10.0, 20.0, 30.0, -1.0, -1.0, 40.0, -1.0));
  EXPECT_EQ(link.counters().overflowed, 3);
  expect_balance(link);
}

TEST(LinkRate, AFullQueueOfBytesDropsWhatDoesNotFit) {
  Link link = link_with({kByteAMillisecond, "rate.queue_bytes=25"});
  std::vector<double> leaves;
  for (const std::size_t bytes : {10U, 10U, 10U, 5U, 1U}) {
    leaves.push_back(ms(link.push(kStart, packet_of(bytes))));
  }
  EXPECT_THAT(leaves, ElementsAre(10.0, 20.0, -1.0, 25.0, -1.0));
}

TEST(LinkRate, CopiesPassTheBottleneckToo) {
  Link link = link_with({kByteAMillisecond, "duplicate.probability=1"});
  EXPECT_EQ(ms(link.push(kStart, packet_of(10))), 10.0);
  EXPECT_EQ(ms(link.copy_departure()), 20.0);
  EXPECT_EQ(ms(link.push(kStart, packet_of(10))), 30.0);
}

// -------------------------------------------------------------------- delay and order

TEST(LinkJitter, AddsToTheStatesDelayAndTheSumIsNeverNegative) {
  Link link =
      link_with({"jitter.law=normal", "jitter.sd_ms=10"}, {1.0, std::chrono::milliseconds{10}});
  constexpr int kPackets = 100'000;
  int at_once = 0, above_mean = 0;
  for (int i = 0; i < kPackets; ++i) {
    const Duration delay = link.push(at_s(i), packet_of(1)) - at_s(i);
    EXPECT_GE(delay, Duration{0});
    at_once += delay == Duration{0} ? 1 : 0;
    above_mean += delay > std::chrono::milliseconds{10} ? 1 : 0;
    pop(link, at_s(i + 1));
  }
  expect_share(at_once, kPackets, 0.15865525393);  // Φ(−1)
  expect_share(above_mean, kPackets, 0.5);
}

std::vector<int> order_of_departure(const Settings& settings) {
  Link link = link_with(settings, {1.0, std::chrono::milliseconds{50}});
  for (int i = 0; i < 200; ++i) link.push(at_ms(i), packet_of(1, static_cast<std::uint8_t>(i)));
  return pop(link, at_s(10));
}

TEST(LinkOrder, JitterReordersUnlessTheLinkKeepsTheOrder) {
  const auto any = order_of_departure({"jitter.law=uniform", "jitter.sd_ms=10"});
  EXPECT_FALSE(std::is_sorted(any.begin(), any.end()));
  const auto kept = order_of_departure({"jitter.law=uniform", "jitter.sd_ms=10", "in_order=true"});
  EXPECT_EQ(kept.size(), 200U);
  EXPECT_TRUE(std::is_sorted(kept.begin(), kept.end()));
}

TEST(LinkOrder, InOrderAPacketWaitsOnlyForThoseBeforeIt) {
  Settings settings{"jitter.law=uniform", "jitter.mean_ms=20", "jitter.sd_ms=10"};
  Link free = link_with(settings);
  settings.emplace_back("in_order=true");
  Link ordered = link_with(settings);
  Instant latest = Instant::min();
  for (int i = 0; i < 1000; ++i) {
    latest = std::max(latest, free.push(at_ms(i), packet_of(1)));
    EXPECT_EQ(ordered.push(at_ms(i), packet_of(1)), latest);
  }
}

TEST(LinkReordering, LetsTheShareSkipTheirDelay) {
  Link link = link_with({"reorder.probability=0.1"}, {1.0, std::chrono::milliseconds{500}});
  constexpr int kPackets = 50'000;
  int at_once = 0;
  for (int i = 0; i < kPackets; ++i)
    at_once += link.push(at_ms(i), packet_of(1)) == at_ms(i) ? 1 : 0;
  expect_share(at_once, kPackets, 0.1);
  EXPECT_EQ(link.counters().reordered, at_once);
}

TEST(LinkReordering, KeepsTheGapBetweenThoseThatSkip) {
  Link link = link_with({"reorder.probability=0.5", "reorder.gap=5"},
                        {1.0, std::chrono::milliseconds{500}});
  int last = -1, skipped = 0, nearest = 1000;
  for (int i = 0; i < 60'000; ++i) {
    if (link.push(at_ms(i), packet_of(1)) != at_ms(i)) continue;
    if (last >= 0) nearest = std::min(nearest, i - last);
    EXPECT_TRUE(last >= 0 || i >= 4);
    last = i;
    ++skipped;
  }
  EXPECT_EQ(nearest, 5);
  // Renewals every 4 + Geometric(1/2) packets: mean 6, variance 2; their number has variance
  // n·2/6³.
  EXPECT_NEAR(skipped, 10'000, kStageSigmas * std::sqrt(60'000 * 2.0 / 216.0));
}

// -------------------------------------------------------------------- all together

const Settings kEverything{"queue_limit=60",
                           "outages=[[1, 1.5], [3, 3.2]]",
                           "loss=0.05",
                           "corrupt.probability=0.1",
                           "corrupt.bits=2",
                           "duplicate.probability=0.2",
                           "rate.bits_per_s=5e5",
                           "rate.queue_packets=20",
                           "jitter.law=gamma",
                           "jitter.mean_ms=20",
                           "jitter.sd_ms=20",
                           "jitter.correlation=0.5",
                           "reorder.probability=0.1",
                           "reorder.gap=3",
                           "slot.period_ms=5"};

TEST(Link, AccountsForEveryPacketWithAllStagesOn) {
  Link link = link_with(kEverything, {0.9, std::chrono::milliseconds{10}});
  for (int i = 0; i < 5000; ++i) {
    link.push(at_ms(i), packet_of(80));
    if (i % 7 == 0) pop(link, at_ms(i));
    expect_balance(link);
  }
  const Link::Counters& c = link.counters();
  EXPECT_EQ(c.outage_dropped, 700);
  for (const std::int64_t count : {c.duplicated, c.lost, c.overflowed, c.corrupted, c.reordered}) {
    EXPECT_GT(count, 50);
  }
  pop(link, at_s(100));
  EXPECT_EQ(link.in_flight(), 0);
  expect_balance(link);
}

TEST(Link, HoldsAHundredThousandPacketsAndRefusesTheNextWithoutForgettingAny) {
  Link link = link_with({"jitter.law=uniform", "jitter.mean_ms=5e4", "jitter.sd_ms=1e4"});
  for (int i = 0; i < 100'000; ++i)
    ASSERT_NE(link.push(at_ms(0.1 * i), packet_of(64)), Instant::max());
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(link.push(at_s(10), packet_of(64)), Instant::max());
  EXPECT_EQ(link.counters().overflowed, 1000);
  Instant before = Instant::min();
  while (link.next_event() != Instant::max()) {
    EXPECT_GE(link.next_event(), before);
    before = link.next_event();
    pop(link, before);
  }
  EXPECT_EQ(link.counters().delivered, 100'000);
  expect_balance(link);
}

}  // namespace
}  // namespace tether
