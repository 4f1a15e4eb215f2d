#include "tools/experiment/statistics/stratified.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "common/base/random.hpp"
#include "tests/tools/experiment/nan.hpp"

namespace tether {
namespace {

TEST(StratifiedMeanTest, WeighsTheMeansOfTheKindsByTheirKnownProbabilities) {
  const auto s = stratified_mean({{0.25, {1.0, 3.0}}, {0.75, {10.0, 10.0, 16.0}}}, 0.95, 1);
  EXPECT_DOUBLE_EQ(s.mean, 0.25 * 2.0 + 0.75 * 12.0);
  EXPECT_EQ(s.n, 5U);
  EXPECT_EQ(s.left_out, 0U);
  EXPECT_TRUE(contains(s.interval, s.mean));
}

TEST(StratifiedMeanTest, DoesNotDependOnHowManyRunsAreOfAKind) {
  const auto few = stratified_mean({{0.5, {1.0, 1.0}}, {0.5, {4.0, 6.0}}}, 0.95, 1);
  const auto many =
      stratified_mean({{0.5, std::vector<double>(50, 1.0)}, {0.5, {6.0, 4.0}}}, 0.95, 1);
  EXPECT_EQ(few.mean, many.mean);
  EXPECT_EQ(few.interval.low, many.interval.low);
  EXPECT_EQ(few.interval.high, many.interval.high);
}

TEST(StratifiedMeanTest, OfKindsWhoseRunsAreAllEqualIsExact) {
  const auto s = stratified_mean({{0.3, {0.1, 0.1, 0.1}}, {0.7, {2.0, 2.0}}}, 0.95, 1);
  EXPECT_DOUBLE_EQ(s.mean, 0.03 + 1.4);
  EXPECT_EQ(half_width(s.interval), 0.0);
}

TEST(StratifiedMeanTest, IsUndefinedWithoutARunOfAKindThatThereIs) {
  const auto s = stratified_mean({{0.5, {1.0, 2.0}}, {0.5, {kNaN}}}, 0.95, 1);
  EXPECT_TRUE(std::isnan(s.mean));
  EXPECT_EQ(s.left_out, 1U);
  const auto certain = stratified_mean({{1.0, {1.0, 2.0}}, {0.0, {}}}, 0.95, 1);
  EXPECT_DOUBLE_EQ(certain.mean, 1.5);
}

TEST(StratifiedMeanTest, HasNoIntervalByOneRunOfAKind) {
  const auto s = stratified_mean({{0.5, {1.0, 2.0}}, {0.5, {3.0}}}, 0.95, 1);
  EXPECT_DOUBLE_EQ(s.mean, 2.25);
  EXPECT_TRUE(std::isnan(s.interval.low));
}

/// Half of the runs are 15, the others uniform on [10, 30]: a mean of 17.5.
struct Both {
  double plain = 0.0;
  StratifiedMean stratified;
};
Both measure(RandomEngine& random, int runs) {
  std::vector<Stratum> strata{{0.5, {}}, {0.5, {}}};
  double sum = 0.0;
  for (int i = 0; i < runs; ++i) {
    const double which = static_cast<double>(random() >> 11) * 0x1p-53;
    const double where = static_cast<double>(random() >> 11) * 0x1p-53;
    const double value = which < 0.5 ? 15.0 : 10.0 + 20.0 * where;
    strata[which < 0.5 ? 0 : 1].values.push_back(value);
    sum += value;
  }
  return {sum / runs, stratified_mean(strata, 0.95, 1)};
}

TEST(StratifiedMeanTest, IsUnbiasedWithLessVarianceAndItsIntervalHoldsTheMean) {
  RandomEngine random = random_stream(1, "stratified_test");
  constexpr int kSets = 400, kRuns = 60;
  double plain = 0.0, stratified = 0.0, sum = 0.0;
  int held = 0;
  for (int set = 0; set < kSets; ++set) {
    const Both both = measure(random, kRuns);
    plain += std::pow(both.plain - 17.5, 2);
    stratified += std::pow(both.stratified.mean - 17.5, 2);
    sum += both.stratified.mean;
    held += contains(both.stratified.interval, 17.5) ? 1 : 0;
  }
  // Manual calculation: the variance of a run is 16.7 + 6.25 (within, between); the first part
  // remains: 0.25 · 33.3/30 = 0.28 of 0.38 m², a share of 0.73. Two such sums of 400 squares differ
  // from their ratio by 4 % (one standard deviation, as they are correlated).
  EXPECT_NEAR(stratified / plain, 0.73, 0.13);
  // Four standard errors, sqrt(0.28/400) each.
  EXPECT_NEAR(sum / kSets, 17.5, 4.0 * 0.0265);
  // 95 % of 400, four standard deviations of 1.1 % and what BCa loses with 30 runs.
  EXPECT_GT(held, static_cast<int>(0.90 * kSets));
}

}  // namespace
}  // namespace tether
