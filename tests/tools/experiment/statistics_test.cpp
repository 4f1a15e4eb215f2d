#include "tools/experiment/statistics/statistics.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <thread>
#include <vector>

#include "tests/tools/experiment/laws.hpp"
#include "tests/tools/experiment/nan.hpp"

namespace tether {
namespace {

using test::EightyTwenty;
using test::LogNormal;
using test::sample;
using test::share_sd;

void expect_interval(const Interval& interval, double low, double high) {
  EXPECT_DOUBLE_EQ(interval.low, low);
  EXPECT_DOUBLE_EQ(interval.high, high);
}

void expect_same(const Interval& a, const Interval& b) { expect_interval(a, b.low, b.high); }

TEST(SummaryTest, HasTheFiguresOfAHandComputedExample) {
  const Summary s = summarize({4.0, 1.0, 3.0, 2.0, 10.0}, 0.95, 1);
  EXPECT_EQ(s.n, 5u);
  EXPECT_EQ(s.left_out, 0u);
  EXPECT_DOUBLE_EQ(s.mean, 4.0);
  EXPECT_DOUBLE_EQ(s.sd, std::sqrt(50.0 / 4.0));
  EXPECT_DOUBLE_EQ(s.median, 3.0);
  EXPECT_DOUBLE_EQ(s.min, 1.0);
  EXPECT_DOUBLE_EQ(s.max, 10.0);
  EXPECT_DOUBLE_EQ(s.q05, 1.2);
  EXPECT_DOUBLE_EQ(s.q25, 2.0);
  EXPECT_DOUBLE_EQ(s.q75, 4.0);
  EXPECT_DOUBLE_EQ(s.q95, 8.8);
}

TEST(SummaryTest, QuantilesLieBetweenTwoValues) {
  EXPECT_DOUBLE_EQ(quantile({1.0, 2.0, 3.0, 4.0}, 0.25), 1.75);
  EXPECT_DOUBLE_EQ(quantile({1.0, 2.0, 3.0, 4.0}, 0.0), 1.0);
  EXPECT_DOUBLE_EQ(quantile({1.0, 2.0, 3.0, 4.0}, 1.0), 4.0);
  EXPECT_DOUBLE_EQ(quantile({7.0}, 0.3), 7.0);
}

TEST(SummaryTest, OfNothingIsUndefined) {
  const Summary s = summarize({kNaN}, 0.95, 1);
  EXPECT_EQ(s.n, 0u);
  EXPECT_EQ(s.left_out, 1u);
  EXPECT_TRUE(std::isnan(s.mean) && std::isnan(s.sd) && std::isnan(s.q05));
  EXPECT_TRUE(std::isnan(s.mean_interval.low) && std::isnan(s.median_interval.high));
}

TEST(SummaryTest, OneRunHasNoSpreadAndNoInterval) {
  const Summary s = summarize({3.0}, 0.95, 1);
  EXPECT_DOUBLE_EQ(s.mean, 3.0);
  EXPECT_DOUBLE_EQ(s.q95, 3.0);
  EXPECT_TRUE(std::isnan(s.sd));
  EXPECT_TRUE(std::isnan(half_width(s.mean_interval)));
  EXPECT_FALSE(half_width(s.mean_interval) <= 1e9);
}

TEST(SummaryTest, EqualRunsHaveAnIntervalOfNoWidth) {
  const Summary s = summarize(std::vector<double>(10, 0.1), 0.95, 1);
  EXPECT_EQ(s.mean, 0.1);
  EXPECT_EQ(s.sd, 0.0);
  EXPECT_EQ(half_width(s.mean_interval), 0.0);
  EXPECT_EQ(half_width(s.median_interval), 0.0);
  EXPECT_TRUE(contains(s.mean_interval, 0.1));
}

TEST(SummaryTest, FailedRunsAreLeftOutAndCounted) {
  const Summary all = summarize({1.0, kNaN, 2.0, 5.0, INFINITY}, 0.95, 1);
  const Summary finite = summarize({1.0, 2.0, 5.0}, 0.95, 1);
  EXPECT_EQ(all.n, 3u);
  EXPECT_EQ(all.left_out, 2u);
  EXPECT_DOUBLE_EQ(all.mean, finite.mean);
  expect_same(all.mean_interval, finite.mean_interval);
}

// P[fewer than k of n below the median] from Pascal's triangle: n = 6: 1/64 for k = 1; n = 10:
// 11/1024 for k = 2, 56/1024 for k = 3.
TEST(MedianIntervalTest, IsBetweenTheOrderStatisticsOfTheBinomialLaw) {
  expect_interval(median_interval({6.0, 5.0, 4.0, 3.0, 2.0, 1.0}, 0.95), 1.0, 6.0);
  const std::vector<double> ten{1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0};
  expect_interval(median_interval(ten, 0.95), 2.0, 9.0);
  expect_interval(median_interval(ten, 0.89), 3.0, 8.0);
  EXPECT_TRUE(std::isnan(median_interval({1.0, 2.0, 3.0, 4.0, 5.0}, 0.95).low));
}

// All 5^5 resamples of these five have been enumerated: z₀ = 0.0968, a = 0.0874, and the interval's
// ends are their quantiles at 0.1643 and 0.9520 (80 %). With 2000 resamples these wander by three
// standard deviations of the quantile's level, ±0.025 and ±0.014, in addition to those of z₀.
TEST(MeanIntervalTest, MatchesTheEnumeratedBootstrapOfFiveValues) {
  const Interval interval = mean_interval({1.0, 2.0, 3.0, 5.0, 13.0}, 0.8, 1);
  EXPECT_NEAR(interval.low, 2.8, 0.21);
  EXPECT_NEAR(interval.high, 8.4, 0.61);
  // The plain percentiles would be these; the correction must show.
  EXPECT_GT(interval.low, 2.41);
}

TEST(MeanIntervalTest, FollowsTheSeedAndNothingElse) {
  const std::vector<double> values{0.3, 2.5, 1.7, 22.0, 1.1, 1.9, 2.2, 0.8};
  std::vector<double> reversed(values.rbegin(), values.rend());
  Interval elsewhere;
  std::thread([&] { elsewhere = mean_interval(reversed, 0.95, 7); }).join();
  expect_same(mean_interval(values, 0.95, 7), elsewhere);
  EXPECT_NE(mean_interval(values, 0.95, 7).low, mean_interval(values, 0.95, 8).low);
}

TEST(MeanIntervalTest, ShiftsAndScalesWithTheValues) {
  const Interval x = mean_interval({1.0, 2.0, 4.0, 8.0, 16.0, 32.0}, 0.95, 3);
  const Interval y = mean_interval({12.0, 14.0, 18.0, 26.0, 42.0, 74.0}, 0.95, 3);
  EXPECT_NEAR(y.low, 10.0 + 2.0 * x.low, 1e-12);
  EXPECT_NEAR(y.high, 10.0 + 2.0 * x.high, 1e-12);
}

TEST(MeanIntervalTest, ReachesFurtherTowardsTheLongTail) {
  RandomEngine random = random_stream(1, "tail");
  const std::vector<double> values = sample(LogNormal(), 50, random);
  const Summary s = summarize(values, 0.95, 1);
  EXPECT_GT(s.mean_interval.high - s.mean, s.mean - s.mean_interval.low);
}

constexpr int kDataSets = 1000;

template <typename Law>
double coverage(const Law& law, std::size_t n) {
  RandomEngine random = random_stream(2, "coverage");
  int covered = 0;
  for (int i = 0; i < kDataSets; ++i) {
    const auto seed = static_cast<std::uint64_t>(i);
    covered += contains(mean_interval(sample(law, n, random), 0.95, seed), law.mean()) ? 1 : 0;
  }
  return static_cast<double>(covered) / kDataSets;
}

// The shares are those of the header, measured over 4000 other data sets. The tolerance is three
// standard deviations of the difference of the two.
void expect_coverage(double measured, double stated, int data_sets = kDataSets) {
  const double sd = std::hypot(share_sd(stated, data_sets), share_sd(stated, 4000));
  EXPECT_NEAR(measured, stated, 3.0 * sd);
}

TEST(MeanIntervalTest, CoversTheMeanOfALogNormalLawLessThanNominally) {
  expect_coverage(coverage(LogNormal(), 50), 0.899);
}

TEST(MeanIntervalTest, CoversTheMeanOfRunsThatAreLostOneInFive) {
  expect_coverage(coverage(EightyTwenty(), 50), 0.957);
}

TEST(MedianIntervalTest, CoversTheMedianAtLeastNominally) {
  RandomEngine random = random_stream(3, "coverage");
  int covered = 0;
  for (int i = 0; i < kDataSets; ++i) {
    covered += contains(median_interval(sample(LogNormal(), 50, random), 0.95), 1.0) ? 1 : 0;
  }
  EXPECT_GT(covered, kDataSets * (0.95 - 3.0 * share_sd(0.95, kDataSets)));
}

// Batches of ten up to 200 until the half width is within 30 % of the mean.
template <typename Law>
double coverage_when_stopped(const Law& law, int data_sets) {
  RandomEngine random = random_stream(2, "stopping");
  int covered = 0;
  for (int i = 0; i < data_sets; ++i) {
    std::vector<double> values;
    Summary s;
    do {
      const std::vector<double> batch = sample(law, kLeastSeeds, random);
      values.insert(values.end(), batch.begin(), batch.end());
      s = summarize(values, 0.95, static_cast<std::uint64_t>(i));
    } while (values.size() < 200 && !(half_width(s.mean_interval) <= 0.3 * s.mean));
    covered += contains(s.mean_interval, law.mean()) ? 1 : 0;
  }
  return static_cast<double>(covered) / data_sets;
}

constexpr int kStoppings = 200;

TEST(MeanIntervalTest, CoversLessWhenItDecidesWhenToStop) {
  expect_coverage(coverage_when_stopped(LogNormal(), kStoppings), 0.868, kStoppings);
  expect_coverage(coverage_when_stopped(EightyTwenty(), kStoppings), 0.848, kStoppings);
}

}  // namespace
}  // namespace tether
