#include "tests/netem/link/two_sample.hpp"

#include <gtest/gtest.h>

#include <boost/random/uniform_01.hpp>
#include <functional>

#include "common/base/random.hpp"

namespace tether::test {
namespace {

TEST(TwoSample, RatiosDifferByTwoSampleStandardDeviations) {
  // Difference 0.01, standard deviation of a difference √2 · 0.005: z = √2.
  EXPECT_NEAR(same_ratio(110, 100, 1000, 0.005), 0.15730, 1e-5);
  EXPECT_DOUBLE_EQ(same_ratio(100, 110, 1000, 0.005), same_ratio(110, 100, 1000, 0.005));
  EXPECT_DOUBLE_EQ(same_ratio(100, 100, 1000, 0.005), 1.0);
}

TEST(TwoSample, ChiSquareOfATwoByTwoTable) {
  // n (ad − bc)² / (row and column sums) = 200 (60·60 − 40·40)² / 100⁴ = 8.
  const ChiSquare found = same_histogram({60, 40}, {40, 60});
  EXPECT_NEAR(found.sum, 8.0, 1e-12);
  EXPECT_EQ(found.degrees_of_freedom, 1);
  EXPECT_NEAR(found.probability(), 0.0046777, 1e-7);
  EXPECT_NEAR(found.probability(2.0), 0.0455003, 1e-7);
}

TEST(TwoSample, ChiSquareOfSamplesOfDifferentSize) {
  // Expected 20, 40, 60 of 120 and 10, 20, 30 of 60.
  const ChiSquare found = same_histogram({25, 35, 60}, {5, 25, 30}, 1);
  EXPECT_NEAR(found.sum, 25.0 / 20 + 25.0 / 40 + 25.0 / 10 + 25.0 / 20, 1e-12);
  EXPECT_EQ(found.degrees_of_freedom, 2);
}

TEST(TwoSample, SparseClassesArePooledWithTheirNeighbours) {
  const ChiSquare found = same_histogram({30, 10, 10, 1, 0, 2}, {30, 12, 8, 0, 3}, 40);
  EXPECT_EQ(found.degrees_of_freedom, 1) << "60 | 22 + 18 + 1 + 3 + 2";
  EXPECT_EQ(same_histogram({5}, {6}, 40).degrees_of_freedom, 0);
}

TEST(TwoSample, SmirnovsTableOfTheLimitLaw) {
  // λ = D √(nm/(n+m)); Smirnov's table: L(0.50) = 0.036055, L(1.00) = 0.730000, L(1.36) = 0.950515.
  std::vector<double> first, second;
  for (int i = 0; i < 200; ++i) first.push_back(i);
  const auto shifted = [&](int by) {
    second = first;
    for (double& x : second) x += by;
    return same_law(first, second);
  };
  EXPECT_NEAR(shifted(20).distance, 0.1, 1e-12);
  EXPECT_NEAR(shifted(20).probability, 1.0 - 0.730000, 1e-6);
  EXPECT_NEAR(shifted(10).probability, 1.0 - 0.036055, 1e-6);
  EXPECT_DOUBLE_EQ(shifted(0).probability, 1.0);
  EXPECT_NEAR(shifted(200).probability, 0.0, 1e-12);
}

TEST(TwoSample, FewOfManyEqualSamplesArePutApart) {
  // 400 pairs at 10 %: 40 expected, standard deviation 6; 5 of them are 30.
  RandomEngine random(1);
  boost::random::uniform_01<double> uniform;
  int laws = 0, histograms = 0;
  for (int pair = 0; pair < 400; ++pair) {
    std::vector<double> values[2];
    std::vector<std::int64_t> counts[2] = {std::vector<std::int64_t>(10),
                                           std::vector<std::int64_t>(10)};
    for (const int side : {0, 1}) {
      for (int i = 0; i < 1000; ++i) {
        values[side].push_back(uniform(random));
        ++counts[side][static_cast<std::size_t>(10 * values[side].back())];
      }
    }
    laws += same_law(values[0], values[1]).probability < 0.1 ? 1 : 0;
    histograms += same_histogram(counts[0], counts[1]).probability() < 0.1 ? 1 : 0;
  }
  EXPECT_NEAR(laws, 40, 30);
  EXPECT_NEAR(histograms, 40, 30);
}

}  // namespace
}  // namespace tether::test
