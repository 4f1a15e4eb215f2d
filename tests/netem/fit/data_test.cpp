#include "netem/fit/data.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <boost/random/exponential_distribution.hpp>
#include <cmath>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/fit/models.hpp"
#include "tests/netem/link/loss_rig.hpp"

// Which packets were lost, by what was received.

namespace tether {
namespace {

TEST(FatesFromReceptions, GapsInTheNumbersAreLosses) {
  const FateLog log = fates_from_receptions({{5, 0.5}, {6, 0.6}, {9, 0.9}, {10, 1.0}});
  ASSERT_EQ(log.segments.size(), 1U);
  const auto& s = log.segments[0];
  ASSERT_EQ(s.size(), 6U);
  EXPECT_EQ(log.lost(), 2);
  EXPECT_TRUE(s[2].lost && s[3].lost);
  EXPECT_NEAR(s[2].time_s, 0.7, 1e-12);
  EXPECT_TRUE(log.periodic);
  EXPECT_NEAR(log.interval_s, 0.1, 1e-12);
}

TEST(FatesFromReceptions, LatePacketsAreNotLostAndCopiesCountOnce) {
  const FateLog log = fates_from_receptions({{1, 0.1}, {3, 0.3}, {2, 0.31}, {3, 0.32}, {4, 0.4}});
  EXPECT_EQ(log.packets(), 4);
  EXPECT_EQ(log.lost(), 0);
  EXPECT_EQ(log.duplicated, 1);
  EXPECT_EQ(log.reordered, 1);
}

TEST(FatesFromReceptions, NumbersThatLeapAreNoChannel) {
  const FateLog log = fates_from_receptions({{0, 0.0}, {1'000'000, 0.0}, {2'000'000, 0.0}});
  EXPECT_EQ(log.packets(), 0);
  EXPECT_EQ(log.implausible, 3);
}

TEST(FatesFromReceptions, ASenderThatRestartsBeginsASegment) {
  const FateLog log = fates_from_receptions({{5000, 0.0},
                                             {5001, 0.1},
                                             {5002, 0.2},
                                             {0, 0.3},
                                             {2, 0.5},
                                             {3, 0.6},
                                             {3'000'000, 0.7},
                                             {3'000'001, 0.8},
                                             {3'000'002, 0.9}});
  ASSERT_EQ(log.segments.size(), 3U);
  EXPECT_EQ(log.packets(), 10);
  EXPECT_EQ(log.lost(), 1);
  EXPECT_EQ(log.implausible, 0);
}

/// 4000 packets at 20 Hz, a fifth of which is lost; `number` says which they claim to be.
std::vector<Reception> arrivals(const std::function<std::int64_t(std::int64_t)>& number,
                                std::uint64_t seed = 1) {
  RandomEngine random(seed);
  std::vector<Reception> all;
  for (std::int64_t i = 0; i < 4000; ++i) {
    const double jitter_s = 0.03 * uniform_01(random);
    if (uniform_01(random) >= 0.2) {
      all.push_back({number(i), 0.05 * static_cast<double>(i) + jitter_s});
    }
  }
  return all;
}

// 4000 packets less those beyond the runs' ends; the loss ratio's standard deviation is 0.0063.
void expect_a_fifth_lost(const FateLog& log) {
  EXPECT_NEAR(static_cast<double>(log.packets()), 4000.0, 30.0);
  EXPECT_NEAR(static_cast<double>(log.lost()) / static_cast<double>(log.packets()), 0.2, 0.032);
  EXPECT_NEAR(log.interval_s, 0.05, 0.001);
  EXPECT_TRUE(log.periodic);
}

TEST(FatesFromReceptions, ARestartWithinAThousandNumbersIsNoReordering) {
  const FateLog once = fates_from_receptions(arrivals([](auto i) { return i % 3000; }));
  EXPECT_EQ(once.segments.size(), 2U);
  expect_a_fifth_lost(once);
  const FateLog early =
      fates_from_receptions(arrivals([](auto i) { return i < 1000 ? i : i - 1000; }));
  EXPECT_EQ(early.segments.size(), 2U);
  expect_a_fifth_lost(early);
  for (const int wrap : {1000, 100, 50}) {
    const FateLog often = fates_from_receptions(arrivals([wrap](auto i) { return i % wrap; }));
    EXPECT_EQ(often.segments.size(), static_cast<std::size_t>(4000 / wrap)) << wrap;
    EXPECT_EQ(often.implausible, 0) << wrap;
    EXPECT_EQ(often.duplicated, 0) << wrap;
    EXPECT_NEAR(static_cast<double>(often.lost()) / static_cast<double>(often.packets()), 0.2,
                0.032)
        << wrap;
  }
}

TEST(FatesFromReceptions, ADamagedNumberOrTimeIsLeftOutAndCounted) {
  const std::vector<Reception> right = arrivals([](auto i) { return i; });
  for (const std::size_t at : {0UL, 1UL, 2000UL, right.size() - 1}) {
    for (const std::int64_t off : {50'000L, -50'000L, 1L << 62, -(1L << 62), 300L}) {
      std::vector<Reception> wrong = right;
      wrong[at].seq += off;
      const FateLog log = fates_from_receptions(wrong);
      EXPECT_EQ(log.implausible, 1) << at << " " << off;
      EXPECT_EQ(log.segments.size(), 1U);
      expect_a_fifth_lost(log);
    }
    for (const double off_s : {1e4, -1e4, 1e12, -1e12}) {
      std::vector<Reception> wrong = right;
      wrong[at].time_s += off_s;
      const FateLog log = fates_from_receptions(wrong);
      EXPECT_EQ(log.implausible, 1) << at << " " << off_s;
      expect_a_fifth_lost(log);
    }
  }
}

TEST(FatesFromReceptions, CopiesAndPacketsHeldBackBelongToTheirRun) {
  RandomEngine random(3);
  std::vector<Reception> all;
  for (int i = 0; i < 4000; ++i) {
    if (uniform_01(random) < 0.3) continue;
    const double sent_s = 0.05 * i;
    const bool held = i % 400 < 30;  // for up to 1.5 s, then released at once
    all.push_back({i, held ? std::max(sent_s, 20.0 * (i / 400) + 1.5) : sent_s + 0.01});
    if (uniform_01(random) < 0.4) all.push_back({i, all.back().time_s + uniform_01(random)});
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Reception& a, const Reception& b) { return a.time_s < b.time_s; });
  const FateLog log = fates_from_receptions(all);
  EXPECT_EQ(log.segments.size(), 1U);
  EXPECT_EQ(log.implausible, 0);
  EXPECT_NEAR(static_cast<double>(log.lost()), 1200.0, 145.0);  // 5 standard deviations
}

TEST(FatesFromReceptions, AnEventDrivenSenderMayPauseAndHurry) {
  std::vector<Reception> all;
  double t = 0.0;
  std::int64_t lost = 0;
  RandomEngine random(4);
  for (int i = 0; i < 4000; ++i) {
    t += i % 100 == 0 ? 1000.0 * uniform_01(random) : 0.001;
    if (uniform_01(random) < 0.2 && i > 0 && i < 3999) {
      ++lost;
    } else {
      all.push_back({i, t});
    }
  }
  const FateLog log = fates_from_receptions(all);
  EXPECT_EQ(log.segments.size(), 1U);
  EXPECT_EQ(log.implausible, 0);
  EXPECT_EQ(log.lost(), lost);
}

TEST(FatesFromReceptions, LongOutagesAreLosses) {
  std::vector<Reception> all = arrivals([](auto i) { return i; });
  std::erase_if(all, [](const Reception& r) { return r.seq > 500 && r.seq < 3000; });
  const FateLog log = fates_from_receptions(all);
  EXPECT_EQ(log.segments.size(), 1U);
  EXPECT_EQ(log.implausible, 0);
  EXPECT_GE(log.lost(), 2499);
}

TEST(FatesFromReceptions, DelaysDoNotMakeAPeriodicSenderIrregular) {
  std::vector<Reception> late, irregular;
  RandomEngine random(1);
  double t = 0.0;
  for (int i = 0; i < 1000; ++i) {
    late.push_back({i, 0.05 * i + (i / 100 % 2 == 1 ? 0.5 : 0.0)});
    irregular.push_back({i, t += boost::random::exponential_distribution<double>(20.0)(random)});
  }
  EXPECT_TRUE(fates_from_receptions(late).periodic);
  EXPECT_FALSE(fates_from_receptions(irregular).periodic);
}

}  // namespace
}  // namespace tether
