#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <map>
#include <vector>

#include "netem/medium/scheduled_cell.hpp"

// Who is served first, and what of that which waits is kept.

namespace tether {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using Serve = ScheduledRules::Serve;

constexpr Duration kSlot = microseconds{500};

/// Grants at once; a packet takes a slot.
ScheduledRules rules(Serve serve) {
  return {.request_period = Duration{1}, .offset = Duration{0}, .serve = serve};
}

/// Users that push a packet each `periods` slots, all from the first slot on, as it begins; the
/// id is the user's number plus 100 times that of the slot.
struct Periodic {
  std::vector<int> periods;
  int slots;
  bool keep_newest;
};

struct Delivered {
  std::uint64_t id;
  Instant at;
  bool operator==(const Delivered&) const = default;
};

std::vector<Delivered> serve(const ScheduledRules& rules, const Periodic& load) {
  std::vector<Delivered> all;
  ScheduledCell cell(rules, 1, [&](const PacketEnd& end) {
    if (end.delivered) all.push_back({end.id, end.at});
  });
  for (std::size_t i = 0; i < load.periods.size(); ++i) {
    cell.add(fmt::format("AGV{}", i), {.keeps_newest = load.keep_newest});
  }
  std::int64_t pushed = 0, waiting = 0;
  for (int slot = 0; slot < load.slots; ++slot) {
    for (std::size_t i = 0; i < load.periods.size(); ++i) {
      if (slot % load.periods[i] != 0) continue;
      cell.push(kStart + slot * kSlot, i, 100 * static_cast<std::uint64_t>(slot) + i, 80);
      ++pushed;
    }
    cell.advance(kStart + slot * kSlot);
  }
  for (std::size_t i = 0; i < load.periods.size(); ++i) {
    waiting += static_cast<std::int64_t>(cell.waiting(i));
  }
  const ScheduledCell::Counters& c = cell.counters();
  EXPECT_EQ(pushed, c.delivered + c.lost + c.overflowed + c.replaced + waiting);
  return all;
}

/// The same, written out slot by slot: what waits, and how old what was delivered is.
std::vector<Delivered> by_hand(const Periodic& load) {
  const std::size_t n = load.periods.size();
  std::vector<std::vector<int>> waiting(n);
  std::vector<int> newest(n, -1'000'000);
  std::vector<Delivered> all;
  std::size_t last = 0;
  for (int slot = 0; slot < load.slots; ++slot) {
    for (std::size_t i = 0; i < n; ++i) {
      if (slot % load.periods[i] != 0) continue;
      if (load.keep_newest) waiting[i].clear();
      waiting[i].push_back(slot);
    }
    std::size_t best = n;
    for (std::size_t k = 1; k <= n; ++k) {
      const std::size_t i = (last + k) % n;
      if (!waiting[i].empty() && (best == n || newest[i] < newest[best])) best = i;
    }
    if (best == n) continue;
    last = best;
    newest[best] = waiting[best].front();
    all.push_back(
        {100 * static_cast<std::uint64_t>(newest[best]) + best, kStart + (slot + 1) * kSlot});
    waiting[best].erase(waiting[best].begin());
  }
  return all;
}

/// Mean of each user's largest age before each delivery, in slots; those from the second on.
double mean_peak_age(const std::vector<Delivered>& all, std::size_t user) {
  double sum = 0.0, count = 0.0;
  std::int64_t before = -1;
  for (const Delivered& d : all) {
    if (d.id % 100 != user) continue;
    const auto sampled = static_cast<std::int64_t>(d.id / 100);
    if (before >= 0) {
      sum += static_cast<double>((d.at - kStart) / kSlot - before);
      ++count;
    }
    before = sampled;
  }
  return sum / count;
}

TEST(OldestFirst, IsRoundRobinForEqualSources) {
  for (const int period : {1, 3, 7, 9}) {
    for (const bool keep_newest : {false, true}) {
      const Periodic load{std::vector<int>(7, period), 300, keep_newest};
      ScheduledRules in_turn = rules(Serve::round_robin), oldest = rules(Serve::oldest_first);
      in_turn.queue = oldest.queue = 1000;
      EXPECT_EQ(serve(in_turn, load), serve(oldest, load)) << period << keep_newest;
    }
  }
}

// Each of n users has something new in each slot. It is served every n slots; before a delivery,
// at the end of a slot, the last one was sampled n + 1 slots ago.
TEST(OldestFirst, OfNThatAlwaysHaveNewsEachHasAPeakAgeOfNPlusOneSlots) {
  for (const int n : {1, 2, 5, 12}) {
    const auto all = serve(rules(Serve::oldest_first),
                           {std::vector<int>(static_cast<std::size_t>(n), 1), 50 * n, true});
    for (int i = 0; i < n; ++i) {
      EXPECT_DOUBLE_EQ(mean_peak_age(all, static_cast<std::size_t>(i)), n + 1) << n << " " << i;
    }
  }
}

// Under full load and less, with queues and without.
TEST(OldestFirst, ServesUnequalSourcesAsWorkedOutSlotBySlot) {
  for (const auto& periods : std::vector<std::vector<int>>{
           {2, 3, 5, 7}, {3, 5, 7, 11}, {1, 10}, {1, 1, 40}, {4, 2, 9, 2, 30}}) {
    for (const bool keep_newest : {false, true}) {
      const Periodic load{periods, 2000, keep_newest};
      ScheduledRules oldest = rules(Serve::oldest_first);
      oldest.queue = 10'000;
      const auto all = serve(oldest, load);
      EXPECT_EQ(all, by_hand(load));
      for (std::size_t i = 0; i < periods.size(); ++i) {
        EXPECT_DOUBLE_EQ(mean_peak_age(all, i), mean_peak_age(by_hand(load), i));
      }
    }
  }
}

// Two always have news, the third every 40 slots, one after a request. In turn it waits for both,
// by age for none: it is sent at once, and is new 41 slots after the one before.
TEST(OldestFirst, LetsWhoIsSeldomHeardGoFirst) {
  const Periodic load{{1, 1, 40}, 4000, true};
  const auto oldest = serve(rules(Serve::oldest_first), load);
  const auto in_turn = serve(rules(Serve::round_robin), load);
  EXPECT_DOUBLE_EQ(mean_peak_age(oldest, 2), 41.0);
  EXPECT_GT(mean_peak_age(in_turn, 2), 41.2);
}

// Two users push in each slot, and their queues grow without end; a vehicle pushes each 10 slots.
TEST(OldestFirst, LetsNoUserStarveForTrafficWithoutAge) {
  for (const bool has_age : {false, true}) {
    ScheduledRules endless = rules(Serve::oldest_first);
    endless.queue = 10'000;
    std::vector<Duration> delays;
    ScheduledCell cell(endless, 1, [&](const PacketEnd& end) {
      if (end.delivered && end.id > 0)
        delays.push_back(end.at - (kStart + static_cast<std::int64_t>(end.id) * kSlot));
    });
    cell.add("camera 1", {.has_age = has_age});
    cell.add("camera 2", {.has_age = has_age});
    cell.add("AGV", {.keeps_newest = true});
    for (int slot = 0; slot < 1000; ++slot) {
      const Instant now = kStart + slot * kSlot;
      for (std::size_t camera = 0; camera < 2; ++camera) cell.push(now, camera, 0, 80);
      if (slot % 10 == 5) cell.push(now, 2, static_cast<std::uint64_t>(slot), 80);
      cell.advance(now);
    }
    if (has_age) {
      EXPECT_LT(delays.size(), 10U) << "what waits at the cameras is always older";
    } else {
      EXPECT_EQ(delays, std::vector<Duration>(100, kSlot));
    }
  }
}

// ------------------------------------------------------------------------------ messages

struct Ends {
  std::map<std::uint64_t, PacketEnd> of;
  ScheduledCell cell;
  explicit Ends(const ScheduledRules& rules)
      : cell(rules, 1, [this](const PacketEnd& end) { of[end.id] = end; }) {}
};

TEST(KeepNewest, ReplacesWhatWaitsAndTakesItsGrant) {
  Ends ends({.request_period = milliseconds{20}, .offset = Duration{0}});
  ends.cell.add("AGV", {.keeps_newest = true});
  ends.cell.push(kStart, 0, 1, 80);
  const Instant granted = ends.cell.next_event();
  ASSERT_GT(granted, kStart + milliseconds{1});
  ends.cell.push(granted - microseconds{10}, 0, 2, 80);
  EXPECT_FALSE(ends.of.at(1).delivered);
  EXPECT_EQ(ends.of.at(1).at, granted - microseconds{10});
  ends.cell.advance(kStart + milliseconds{100});
  EXPECT_EQ(ends.of.at(2).at, granted + kSlot);
  EXPECT_EQ(ends.cell.counters().replaced, 1);
}

// One of four fragments is sent per slot; a message that has begun goes on, others that wait are
// replaced as a whole.
TEST(KeepNewest, LeavesAMessageWholeOfWhichAPartWasSent) {
  ScheduledRules fragments = rules(Serve::oldest_first);
  fragments.ids_of_a_message = 64;
  Ends ends(fragments);
  ends.cell.add("AGV", {.keeps_newest = true});
  const auto push = [&](Instant now, std::uint64_t message) {
    for (std::uint64_t i = 0; i < 4; ++i) ends.cell.push(now, 0, 64 * message + i, 80);
  };
  push(kStart, 1);
  ends.cell.advance(kStart + kSlot);  // two of the four
  push(kStart + kSlot + microseconds{1}, 2);
  push(kStart + kSlot + microseconds{2}, 3);
  ends.cell.advance(kStart + milliseconds{100});
  for (std::uint64_t i = 0; i < 4; ++i) {
    EXPECT_TRUE(ends.of.at(64 + i).delivered) << i;
    EXPECT_FALSE(ends.of.at(128 + i).delivered) << i;
    EXPECT_TRUE(ends.of.at(192 + i).delivered) << i;
  }
  EXPECT_EQ(ends.cell.counters().replaced, 4);
}

// A message of three fragments is not news before its last one: its user goes on being served
// before one whose message is younger.
TEST(OldestFirst, CountsAMessageWithItsLastFragment) {
  ScheduledRules fragments = rules(Serve::oldest_first);
  fragments.ids_of_a_message = 64;
  Ends ends(fragments);
  ends.cell.add("long");
  ends.cell.add("short");
  ends.cell.push(kStart, 0, 64, 80);
  ends.cell.push(kStart, 1, 640, 80);
  ends.cell.advance(kStart + milliseconds{2});  // both are known now, the former sooner
  const Instant then = kStart + milliseconds{10};
  ends.cell.push(then - milliseconds{5}, 1, 704, 80);
  for (std::uint64_t i = 0; i < 3; ++i) ends.cell.push(then, 0, 128 + i, 80);
  ends.cell.push(then, 1, 768, 80);
  ends.cell.advance(then + milliseconds{10});
  EXPECT_LT(ends.of.at(130).at, ends.of.at(768).at);
  EXPECT_EQ(ends.of.at(130).at, then + 3 * kSlot);
}

// Two of three fragments fit into the queue. Both vehicles' messages are equally old, and the first
// vehicle was served last; but nothing of it has arrived as a whole.
TEST(OldestFirst, DoesNotCountABrokenMessage) {
  ScheduledRules small = rules(Serve::oldest_first);
  small.ids_of_a_message = 64;
  small.queue = 2;
  Ends ends(small);
  ends.cell.add("AGV0");
  ends.cell.add("AGV1");
  for (std::uint64_t i = 0; i < 3; ++i) EXPECT_EQ(ends.cell.push(kStart, 0, 64 + i, 80), i < 2);
  EXPECT_TRUE(ends.cell.push(kStart, 1, 640, 80));
  ends.cell.advance(kStart + milliseconds{5});
  ASSERT_LT(ends.of.at(640).at, ends.of.at(65).at);
  const Instant then = kStart + milliseconds{10};
  ends.cell.push(then, 0, 128, 80);
  ends.cell.push(then, 1, 704, 80);
  ends.cell.advance(then + milliseconds{5});
  EXPECT_LT(ends.of.at(128).at, ends.of.at(704).at);
}

TEST(KeepNewest, AccountsForEveryPacketUnderLossAndOverflow) {
  ScheduledRules lossy{.rate_Mbps = 2.0, .error_ratio = 0.4, .attempts = 2, .queue = 3};
  lossy.serve = Serve::oldest_first;
  lossy.ids_of_a_message = 64;
  std::int64_t ended = 0, pushed = 0, refused = 0, waiting = 0;
  ScheduledCell cell(lossy, 1, [&](const PacketEnd&) { ++ended; });
  for (int i = 0; i < 5; ++i) cell.add(fmt::format("AGV{}", i), {.keeps_newest = i % 2 == 0});
  RandomEngine random(3);
  Instant now = kStart;
  for (std::uint64_t m = 0; m < 3000; ++m) {
    now += from_seconds(0.004 * uniform_01(random));
    const auto user = static_cast<std::size_t>(5 * uniform_01(random));
    for (std::uint64_t i = 0; i <= m % 3; ++i) {
      ++pushed;
      if (!cell.push(now, user, 64 * m + i, 400)) ++refused;
    }
  }
  for (std::size_t i = 0; i < 5; ++i) waiting += static_cast<std::int64_t>(cell.waiting(i));
  const ScheduledCell::Counters& c = cell.counters();
  EXPECT_EQ(pushed, c.delivered + c.lost + c.overflowed + c.replaced + waiting);
  EXPECT_EQ(ended, c.delivered + c.lost + c.replaced);
  EXPECT_EQ(refused, c.overflowed);
  for (const std::int64_t some : {c.delivered, c.lost, c.overflowed, c.replaced})
    EXPECT_GT(some, 0);
}

// Users have something new in each slot, worth the slots since what was delivered, times the user's
// speed; nothing delivered: infinity. Which is served, slot by slot, with two: both infinite, so
// the one after user 0; then user 0; then of 3·1 and 1·2 the fast one, and of 3·1 and 1·3, which
// are equal, the one after the last served.
TEST(MostValuable, ServesWhoseReceiverKnowsLeastAndOfEqualsTheNextInTurn) {
  const auto served = [](const std::vector<double>& speeds, int slots) {
    std::vector<std::size_t> order;
    std::vector<double> known(speeds.size(), -std::numeric_limits<double>::infinity());
    ScheduledCell cell(rules(Serve::most_valuable), 1, [&](const PacketEnd& end) {
      if (!end.delivered) return;
      order.push_back(end.id % 100);
      known[end.id % 100] = static_cast<double>(end.id / 100);
    });
    cell.set_value([&](std::uint64_t id) {
      return speeds[id % 100] * (static_cast<double>(id / 100) - known[id % 100]);
    });
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      cell.add(fmt::format("AGV{}", i), {.keeps_newest = true});
    }
    for (int slot = 0; slot < slots; ++slot) {
      for (std::size_t i = 0; i < speeds.size(); ++i) {
        cell.push(kStart + slot * kSlot, i, 100 * static_cast<std::uint64_t>(slot) + i, 80);
      }
      cell.advance(kStart + slot * kSlot);
    }
    return order;
  };
  EXPECT_EQ(served({3.0, 1.0}, 9), (std::vector<std::size_t>{1, 0, 0, 1, 0, 0, 1, 0, 0}));
  EXPECT_EQ(served({1.0, 1.0, 1.0}, 6), (std::vector<std::size_t>{1, 2, 0, 1, 2, 0}));
}

TEST(MostValuable, IsInTurnWithoutValues) {
  const Periodic load{std::vector<int>(5, 2), 200, true};
  EXPECT_EQ(serve(rules(Serve::most_valuable), load), serve(rules(Serve::round_robin), load));
}

}  // namespace
}  // namespace tether
