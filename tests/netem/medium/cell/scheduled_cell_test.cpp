#include "netem/medium/scheduled_cell.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

namespace tether {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

/// A cell whose packets' ends can be looked up.
struct CellRig {
  explicit CellRig(const ScheduledRules& rules)
      : cell(rules, 1, [this](const PacketEnd& end) { ends[end.id] = end; }) {}
  void finish() { cell.advance(Instant::max() - milliseconds{1000}); }
  std::map<std::uint64_t, PacketEnd> ends;
  ScheduledCell cell;
};

// Request, grant, slot and transmission are sums of uniform and constant parts; each repeat adds
// repeat_after and a transmission. 20 000 packets far apart: four standard errors of the mean.
TEST(ScheduledCell, HasTheClosedFormsDelayWhenUnloaded) {
  ScheduledRules rules;
  rules.error_ratio = 0.1;
  CellRig rig(rules);
  const std::size_t user = rig.cell.add("AGV");
  std::vector<Instant> sent;
  RandomEngine random(2);
  Instant now = kStart;
  for (std::uint64_t i = 0; i < 20'000; ++i) {
    now += milliseconds{200} + from_seconds(0.02 * uniform_01(random));
    sent.push_back(now);
    ASSERT_TRUE(rig.cell.push(now, user, i, 80));
  }
  rig.finish();
  const double period = to_seconds(rules.request_period), slot = to_seconds(rules.slot);
  const double repeat = to_seconds(rules.repeat_after) + slot;
  // Attempts of those that arrive: geometric, cut off at four.
  const double e = rules.error_ratio;
  const double repeats = (e + 2 * e * e + 3 * e * e * e) / (1 + e + e * e + e * e * e);
  // The request's phase decides how far its grant is from a slot.
  double sum = 0.0, count = 0.0, least = 1.0;
  for (const auto& [id, end] : rig.ends) {
    if (!end.delivered) continue;
    const double delay = to_seconds(end.at - sent[id]);
    sum += delay - repeat * (end.attempts - 1);
    least = std::min(least, delay);
    ++count;
  }
  const double waits_for_slot = least - to_seconds(rules.offset) - slot;
  ASSERT_GE(waits_for_slot, 0.0);
  ASSERT_LT(waits_for_slot, slot + 1e-4);
  const double expected = period / 2 + least;
  EXPECT_NEAR(sum / count, expected, 4 * period / std::sqrt(12.0 * count) + 1e-5);
  double attempts = 0.0;
  for (const auto& [id, end] : rig.ends) attempts += end.delivered ? end.attempts - 1 : 0;
  EXPECT_NEAR(attempts / count, repeats, 4 * std::sqrt(e / count));
  // Lost: all four attempts failed, e^4 of 20 000 are 2.
  EXPECT_LE(rig.cell.counters().lost, 9);
}

// All packets of a period come at once; each takes one slot.
TEST(ScheduledCell, LetsTheLastOfNEqualSourcesWaitForNMinusOneTurns) {
  constexpr int kUsers = 10;
  ScheduledRules rules{.request_period = microseconds{1}, .offset = Duration{0}};
  CellRig rig(rules);
  for (int i = 0; i < kUsers; ++i) rig.cell.add(fmt::format("AGV{}", i));
  Duration worst{0};
  std::map<std::uint64_t, Instant> sent;
  for (std::uint64_t round = 0; round < 100; ++round) {
    const Instant now = kStart + round * milliseconds{20} + microseconds{500} - microseconds{1};
    for (std::size_t i = 0; i < kUsers; ++i) {
      sent[round * kUsers + i] = now + microseconds{1};
      rig.cell.push(now, i, round * kUsers + i, 80);
    }
  }
  rig.finish();
  for (const auto& [id, end] : rig.ends) {
    worst = std::max(worst, end.at - sent[id] - rules.slot);
  }
  EXPECT_EQ(worst, (kUsers - 1) * rules.slot);
}

TEST(ScheduledCell, SharesTheCellEquallyBetweenThoseWhoWantMore) {
  CellRig rig({.rate_Mbps = 10.0, .queue = 100'000});
  for (int i = 0; i < 3; ++i) rig.cell.add(fmt::format("AGV{}", i));
  for (std::uint64_t i = 0; i < 3000; ++i) rig.cell.push(kStart, i % 3, i, 1200);
  rig.cell.advance(kStart + milliseconds{1000});
  std::vector<int> served(3);
  for (const auto& [id, end] : rig.ends) ++served[id % 3];
  EXPECT_LE(*std::max_element(served.begin(), served.end()) -
                *std::min_element(served.begin(), served.end()),
            20);  // whose first grant came later
  EXPECT_NEAR(to_seconds(rig.cell.counters().busy), 1.0, 0.03);
}

TEST(ScheduledCell, ServesTheMostUrgentFirstWhereToldTo) {
  CellRig rig({.request_period = microseconds{1}, .offset = Duration{0}});
  for (int i = 0; i < 5; ++i) rig.cell.add(fmt::format("AGV{}", i));
  rig.cell.set_urgency(
      [](std::size_t user, Instant, Instant) { return static_cast<double>(user); });
  for (std::uint64_t i = 0; i < 5; ++i) rig.cell.push(kStart, i, i, 80);
  rig.finish();
  for (std::uint64_t i = 1; i < 5; ++i) EXPECT_LT(rig.ends[i].at, rig.ends[i - 1].at);
}

TEST(ScheduledCell, AccountsForEveryPacket) {
  ScheduledRules rules{.rate_Mbps = 2.0, .error_ratio = 0.4, .attempts = 2, .queue = 5};
  CellRig rig(rules);
  std::int64_t pushed = 0;
  for (int i = 0; i < 7; ++i) rig.cell.add(fmt::format("AGV{}", i));
  RandomEngine random(3);
  Instant now = kStart;
  for (int i = 0; i < 5000; ++i) {
    now += from_seconds(0.002 * uniform_01(random));
    const auto user = static_cast<std::size_t>(7 * uniform_01(random));
    rig.cell.push(now, user, static_cast<std::uint64_t>(i), 400);
    ++pushed;
  }
  std::int64_t waiting = 0;
  for (std::size_t i = 0; i < 7; ++i) waiting += static_cast<std::int64_t>(rig.cell.waiting(i));
  const ScheduledCell::Counters& c = rig.cell.counters();
  EXPECT_EQ(pushed, c.delivered + c.lost + c.overflowed + waiting);
  EXPECT_GT(c.overflowed, 0);
  EXPECT_GT(c.lost, 0);
}

// One more vehicle changes when others are served, not what their transmissions meet.
TEST(ScheduledCell, LeavesTheLuckOfOthersAloneWhenAUserIsAdded) {
  const auto attempts_of_first = [](int users) {
    CellRig rig({.error_ratio = 0.3, .attempts = 8});
    for (int i = 0; i < users; ++i) rig.cell.add(fmt::format("AGV{}", i));
    for (std::uint64_t n = 0; n < 200; ++n) {
      for (std::size_t i = 0; i < static_cast<std::size_t>(users); ++i) {
        rig.cell.push(kStart + n * milliseconds{100}, i, n + 1000 * i, 80);
      }
    }
    rig.finish();
    std::vector<int> attempts;
    for (std::uint64_t n = 0; n < 200; ++n) attempts.push_back(rig.ends[n].attempts);
    return attempts;
  };
  EXPECT_EQ(attempts_of_first(1), attempts_of_first(5));
}

}  // namespace
}  // namespace tether
