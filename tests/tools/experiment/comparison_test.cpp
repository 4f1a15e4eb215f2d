#include "tools/experiment/statistics/comparison.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <boost/random/normal_distribution.hpp>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/tools/experiment/laws.hpp"
#include "tests/tools/experiment/nan.hpp"

namespace tether {
namespace {

using test::EightyTwenty;
using test::share_sd;
using Arm = std::vector<SeededValue>;

Arm arm(const std::vector<double>& values) {
  Arm runs;
  for (std::size_t i = 0; i < values.size(); ++i) runs.push_back({i + 1, values[i]});
  return runs;
}

TEST(PairedDifferenceTest, IsTakenOverTheCommonSeeds) {
  const Arm first{{1, 5.0}, {2, 7.0}, {3, 9.0}, {4, kNaN}, {6, 1.0}};
  const Arm second{{3, 5.0}, {2, 4.0}, {1, 3.0}, {4, 2.0}, {5, 1.0}};
  const PairedDifference d = paired_difference(first, second, 0.95, 1);
  EXPECT_EQ(d.difference.n, 3u);
  EXPECT_EQ(d.left_out, 3u);  // 4 failed once, 5 and 6 ran in one arm only
  EXPECT_DOUBLE_EQ(d.difference.mean, 3.0);
  EXPECT_DOUBLE_EQ(d.difference.sd, 1.0);
}

TEST(PairedDifferenceTest, SeparatesASmallEffectUnderALargeCommonSpread) {
  RandomEngine random = random_stream(1, "pairs");
  boost::random::normal_distribution<double> noise(0.0, 0.1);
  std::vector<double> x, y;
  for (int i = 0; i < 20; ++i) {
    const double common = EightyTwenty()(random);
    x.push_back(common + 0.3 + noise(random));
    y.push_back(common + noise(random));
  }
  const PairedDifference d = paired_difference(arm(x), arm(y), 0.95, 1);
  EXPECT_TRUE(d.separated);
  EXPECT_GT(d.difference.mean_interval.low, 0.0);
  EXPECT_FALSE(paired_difference(arm(x), arm(x), 0.95, 1).separated);
}

TEST(PairedDifferenceTest, FiveOrFewerPairsSeparateNothing) {
  EXPECT_FALSE(paired_difference(arm({9, 9, 9, 9, 9}), arm({1, 1, 1, 1, 1}), 0.95, 1).separated);
  EXPECT_TRUE(
      paired_difference(arm({9, 9, 9, 9, 9, 9}), arm({1, 1, 1, 1, 1, 1}), 0.95, 1).separated);
  EXPECT_FALSE(paired_difference(arm({9}), arm({1}), 0.95, 1).separated);
  EXPECT_FALSE(paired_difference({}, arm({1}), 0.95, 1).separated);
}

// Arms that share half of their variance, as runs with one seed do; `shift` sd apart.
std::vector<Arm> normal_arms(std::size_t count, std::size_t n, double shift, RandomEngine& random) {
  boost::random::normal_distribution<double> normal;
  std::vector<std::vector<double>> columns(count);
  for (std::size_t i = 0; i < n; ++i) {
    const double common = normal(random);
    for (std::size_t k = 0; k < count; ++k) {
      const double value = std::sqrt(0.5) * (common + normal(random));
      columns[k].push_back(value + shift * static_cast<double>(k));
    }
  }
  std::vector<Arm> arms;
  arms.reserve(count);
  for (const auto& column : columns) arms.push_back(arm(column));
  return arms;
}

TEST(TiesOfBestTest, SeparatesWhatIsThreeStandardDeviationsApart) {
  RandomEngine random = random_stream(4, "ties");
  std::vector<Arm> arms = normal_arms(4, 20, 3.0, random);
  std::swap(arms[0], arms[2]);
  const BestArm best = ties_of_best(arms, 0.95, 1);
  EXPECT_EQ(best.best, 2u);
  EXPECT_EQ(best.tied, (std::vector<bool>{false, false, true, false}));
  EXPECT_EQ(best.n, 20u);
  EXPECT_GT(best.differences[0].low, 0.0);
  EXPECT_LT(best.differences[0].low, 6.0);
  EXPECT_GT(best.differences[0].high, 6.0 - 1.0);
}

TEST(TiesOfBestTest, ArmsThatAreEqualRunByRunAreTied) {
  const Arm same = arm({2.0, 2.1, 22.0, 1.9, 2.2, 2.0, 2.4, 21.0});
  const BestArm best = ties_of_best({same, same, same}, 0.95, 1);
  EXPECT_EQ(best.best, 0u);
  EXPECT_EQ(best.tied, (std::vector<bool>{true, true, true}));
}

TEST(TiesOfBestTest, OneRareCatastropheSeparatesNothing) {
  const std::vector<double> good(20, 2.0);
  std::vector<double> once_lost = good;
  once_lost[7] = 22.0;
  const BestArm best = ties_of_best({arm(good), arm(once_lost)}, 0.95, 1);
  EXPECT_EQ(best.best, 0u);
  EXPECT_TRUE(best.tied[1]);
}

TEST(TiesOfBestTest, OneRareCatastropheWidensNoOtherInterval) {
  RandomEngine random = random_stream(8, "ties");
  std::vector<Arm> arms = normal_arms(3, 50, 3.0, random);
  const std::vector<bool> before = ties_of_best(arms, 0.95, 1).tied;
  // An arm as good as the best, run by run, but lost once.
  arms.push_back(arms.front());
  for (SeededValue& run : arms.back()) run.value += 0.001;
  arms.back()[7].value += 20.0;
  const BestArm best = ties_of_best(arms, 0.95, 1);
  EXPECT_EQ(before, (std::vector<bool>{true, false, false}));
  EXPECT_EQ(best.tied, (std::vector<bool>{true, false, false, true}));
}

TEST(TiesOfBestTest, UsesTheSeedsThatAllArmsHave) {
  Arm longer = arm({1, 1, 1, 1, 1, 1, 1, 1, 1, 99});
  const Arm shorter = arm({2, 2, 2, 2, kNaN, 2, 2, 2, 2});
  const BestArm best = ties_of_best({shorter, longer}, 0.95, 1);
  EXPECT_EQ(best.n, 8u);
  EXPECT_EQ(best.left_out, 2u);
  EXPECT_EQ(best.best, 1u);
  EXPECT_DOUBLE_EQ(best.means[1], 1.0);
  EXPECT_FALSE(best.tied[0]);
}

TEST(TiesOfBestTest, AnArmWithoutResultsTakesNoPart) {
  const Arm failed = arm({kNaN, kNaN, kNaN, kNaN, kNaN, kNaN});
  const BestArm best = ties_of_best({failed, arm({1, 2, 3, 4, 5, 6}), {}}, 0.95, 1);
  EXPECT_EQ(best.best, 1u);
  EXPECT_EQ(best.tied, (std::vector<bool>{false, true, false}));
  EXPECT_TRUE(std::isnan(best.means[0]));
  EXPECT_FALSE(ties_of_best({failed}, 0.95, 1).best);
  EXPECT_FALSE(ties_of_best({}, 0.95, 1).best);
  EXPECT_FALSE(ties_of_best({arm({1}), Arm{{2, 1.0}}}, 0.95, 1).best);
}

TEST(TiesOfBestTest, FiveOrFewerSeedsLeaveAllTied) {
  const BestArm best = ties_of_best({arm({1, 1, 1, 1, 1}), arm({9, 9, 9, 9, 9})}, 0.95, 1);
  EXPECT_EQ(best.best, 0u);
  EXPECT_TRUE(best.tied[1]);
}

TEST(TiesOfBestTest, FollowsTheSeedAndNotTheOrderOfRuns) {
  RandomEngine random = random_stream(5, "ties");
  std::vector<Arm> arms = normal_arms(3, 20, 0.4, random);
  const BestArm best = ties_of_best(arms, 0.95, 9);
  for (Arm& runs : arms) std::reverse(runs.begin(), runs.end());
  const BestArm again = ties_of_best(arms, 0.95, 9);
  EXPECT_EQ(best.tied, again.tied);
  EXPECT_EQ(best.differences[2].low, again.differences[2].low);
}

constexpr int kComparedSets = 400;

template <typename Make>
double wrongly_separated(const Make& make) {
  RandomEngine random = random_stream(6, "ties");
  int wrong = 0;
  for (int i = 0; i < kComparedSets; ++i) {
    const BestArm best = ties_of_best(make(random), 0.95, static_cast<std::uint64_t>(i));
    wrong += std::count(best.tied.begin(), best.tied.end(), false) > 0 ? 1 : 0;
  }
  return static_cast<double>(wrong) / kComparedSets;
}

// Three standard deviations of a share of 5 % in 400 data sets: 3.3 %.
TEST(TiesOfBestTest, SeparatesAnyOfFiveEqualArmsInAtMostOneOfTwentyCases) {
  const double wrong =
      wrongly_separated([](RandomEngine& random) { return normal_arms(5, 30, 0.0, random); });
  EXPECT_LE(wrong, 0.05 + 3.0 * share_sd(0.05, kComparedSets));
  EXPECT_GE(wrong, 0.05 - 3.0 * share_sd(0.05, kComparedSets)) << "needlessly cautious";
}

TEST(TiesOfBestTest, SeparatesEqualArmsOfLostRunsRarelyToo) {
  const double wrong = wrongly_separated([](RandomEngine& random) {
    std::vector<Arm> arms;
    for (int k = 0; k < 4; ++k) arms.push_back(arm(test::sample(EightyTwenty(), 30, random)));
    return arms;
  });
  EXPECT_LE(wrong, 0.05 + 3.0 * share_sd(0.05, kComparedSets));
}

}  // namespace
}  // namespace tether
