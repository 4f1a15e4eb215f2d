#include "tools/experiment/statistics/survival.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "tests/tools/experiment/laws.hpp"
#include "tests/tools/experiment/nan.hpp"

namespace tether {
namespace {

using test::RarelyLost;
using test::sample;
using test::share_sd;

// (1 − high)^30 = 2.5 %, calculated manually.
TEST(LostShare, OfNoneReachesUpToWhatWouldShowNoneOneTimeInForty) {
  const Share none = share_of(0, 30, 0.95);
  EXPECT_EQ(none.value, 0.0);
  EXPECT_EQ(none.interval.low, 0.0);
  EXPECT_NEAR(none.interval.high, 1.0 - std::pow(0.025, 1.0 / 30.0), 1e-12);
}

TEST(LostShare, OfAllIsTheMirrorImageOfNone) {
  const Share all = share_of(30, 30, 0.95);
  EXPECT_EQ(all.value, 1.0);
  EXPECT_EQ(all.interval.high, 1.0);
  EXPECT_NEAR(all.interval.low, std::pow(0.025, 1.0 / 30.0), 1e-12);
}

// P[X >= 2] at the low end and P[X <= 2] at the high end are 2.5 %, summed manually.
TEST(LostShare, LeavesTheSameProbabilityAtBothEnds) {
  const Interval i = share_of(2, 10, 0.95).interval;
  const auto at_most = [](int most, double p) {
    double sum = 0.0, choose = 1.0;
    for (int k = 0; k <= most; ++k) {
      sum += choose * std::pow(p, k) * std::pow(1.0 - p, 10 - k);
      choose *= (10.0 - k) / (k + 1.0);
    }
    return sum;
  };
  EXPECT_NEAR(1.0 - at_most(1, i.low), 0.025, 1e-9);
  EXPECT_NEAR(at_most(2, i.high), 0.025, 1e-9);
}

TEST(LostShare, OfNothingIsUnknown) {
  const Share share = share_of(0, 0, 0.95);
  EXPECT_TRUE(std::isnan(share.value));
  EXPECT_TRUE(std::isnan(share.interval.low));
}

TEST(Survivors, AreTheVehiclesThatWereNotLost) {
  const Survival s = survival_of({1.0, 22.0, 3.0, kNaN}, {0.0, 1.0, 0.0, kNaN}, 0.95, 1);
  EXPECT_EQ(s.lost.count, 1U);
  EXPECT_EQ(s.lost.n, 3U) << "a run that failed is neither";
  EXPECT_EQ(s.survivors.n, 2U);
  EXPECT_EQ(s.survivors.mean, 2.0);
}

TEST(Survivors, HaveNoMeanIfAllAreLost) {
  const Survival s = survival_of({20.0, 22.0}, {1.0, 1.0}, 0.95, 1);
  EXPECT_EQ(s.lost.value, 1.0);
  EXPECT_EQ(s.survivors.n, 0U);
  EXPECT_TRUE(std::isnan(s.survivors.mean));
}

TEST(TimesToReturn, AreOfTheRunsThatCameBackAndCountThoseThatDidNot) {
  const Returns r = returns_of({0.0, 2.0, 4.0, 0.0, kNaN}, {0.0, 0.0, 1.0, 9.0, kNaN}, 0.95, 1);
  EXPECT_EQ(r.times.n, 2U);
  EXPECT_EQ(r.times.mean, 3.0);
  EXPECT_EQ(r.not_back, 2U);
}

// How often the three intervals hold the truth, in one pass. The shares are the header's, measured
// over 20000 other data sets; the tolerance is three standard deviations of the difference.
TEST(RarelyLostVehicles, AreHiddenFromTheMeansIntervalAndNotFromTheShares) {
  constexpr int kDataSets = 1000;
  RandomEngine random = random_stream(5, "coverage");
  int of_all = 0, of_share = 0, of_survivors = 0;
  for (int i = 0; i < kDataSets; ++i) {
    const std::vector<double> values = sample(RarelyLost(), 30, random);
    std::vector<double> lost;
    for (const double value : values) lost.push_back(value > 5.0 ? 1.0 : 0.0);
    const auto seed = static_cast<std::uint64_t>(i);
    const Survival s = survival_of(values, lost, 0.95, seed);
    of_all += contains(mean_interval(values, 0.95, seed), RarelyLost().mean()) ? 1 : 0;
    of_share += contains(s.lost.interval, RarelyLost::kLost) ? 1 : 0;
    of_survivors += contains(s.survivors.mean_interval, RarelyLost::kSurvivors_m) ? 1 : 0;
  }
  const auto expect_share = [](int covered, double stated) {
    const double sd = std::hypot(share_sd(stated, kDataSets), share_sd(stated, 20000));
    EXPECT_NEAR(static_cast<double>(covered) / kDataSets, stated, 3.0 * sd);
  };
  expect_share(of_all, 0.671);
  expect_share(of_share, 0.977);
  expect_share(of_survivors, 0.934);
  EXPECT_GT(of_share, kDataSets * (0.95 - 3.0 * share_sd(0.95, kDataSets))) << "never below 95 %";
}

// Exact: the sum of the binomial law over the counts whose interval holds the share.
TEST(LostShare, IsCoveredAtLeastAsOftenAsItSaysWhateverItIs) {
  constexpr int kRuns = 30;
  for (int percent = 1; percent < 100; ++percent) {
    const double p = 0.01 * percent;
    double covered = 0.0, choose = 1.0;
    for (int k = 0; k <= kRuns; ++k) {
      const Share share = share_of(static_cast<std::size_t>(k), kRuns, 0.95);
      if (contains(share.interval, p))
        covered += choose * std::pow(p, k) * std::pow(1.0 - p, kRuns - k);
      choose *= static_cast<double>(kRuns - k) / (k + 1.0);
    }
    EXPECT_GE(covered, 0.95) << p;
  }
}

}  // namespace
}  // namespace tether
