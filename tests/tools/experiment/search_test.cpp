#include "tools/experiment/sweep/search.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

namespace tether {
namespace {

using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::Ge;
using ::testing::IsEmpty;
using ::testing::Le;
using ::testing::Not;

using Objective = std::function<double(const SearchPoint&)>;

std::vector<SearchedPoint> search(const SearchBudget& budget, const SearchPoint& start,
                                  const Objective& objective) {
  std::vector<SearchedPoint> searched;
  for (;;) {
    const std::vector<SearchPoint> points = next_points(budget, {start}, searched);
    if (points.empty()) return searched;
    for (const SearchPoint& point : points) searched.push_back({point, objective(point)});
  }
}

Objective distance_to(const SearchPoint& least) {
  return [least](const SearchPoint& point) {
    double sum = 0.0;
    for (std::size_t i = 0; i < point.size(); ++i) sum += std::pow(point[i] - least[i], 2);
    return std::sqrt(sum);
  };
}

constexpr SearchBudget kBudget{80, 8};

TEST(Search, HasAsManyPointsAsItsBudgetInSoManyRounds) {
  EXPECT_THAT(round_sizes({10, 1}), ElementsAre(10));
  EXPECT_THAT(round_sizes({10, 4}), ElementsAre(4, 2, 2, 2));
  EXPECT_THAT(round_sizes({4, 2}), ElementsAre(2, 2));
  for (std::size_t evaluations = 2; evaluations < 60; ++evaluations) {
    for (std::size_t rounds = 1; rounds <= evaluations / 2; ++rounds) {
      const auto sizes = round_sizes({evaluations, rounds});
      EXPECT_EQ(sizes.size(), rounds);
      EXPECT_EQ(std::accumulate(sizes.begin(), sizes.end(), std::size_t{0}), evaluations);
      EXPECT_THAT(sizes, Each(Ge(1U)));
    }
  }
  EXPECT_EQ(search(kBudget, {0.5}, distance_to({0.3})).size(), 80U);
}

TEST(Search, BeginsWithTheStart) {
  EXPECT_EQ(next_points(kBudget, {{0.1, 0.9}}, {}).front(), (SearchPoint{0.1, 0.9}));
}

TEST(Search, GivenPointsTakeTheFirstPlacesOfTheSequence) {
  const auto alone = next_points({6, 1}, {sequence_point(2, 0)}, {});
  const std::vector<SearchPoint> given{sequence_point(2, 0), {0.1, 0.9}, {0.2, 0.3}};
  const auto points = next_points({6, 1}, given, {});
  ASSERT_EQ(points.size(), 6U);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(points[i], i < 3 ? given[i] : alone[i]) << i;
  }
}

TEST(Search, OneThatSkipsAnothersPointsLooksAtNoneOfThem) {
  EXPECT_EQ(sequence_point(3, 0), (SearchPoint{0.5, 0.5, 0.5})) << "the centre";
  const SearchBudget first{9, 1}, second{9, 1, 9};
  const auto of_first = next_points(first, {sequence_point(2, 0)}, {});
  const auto of_second = next_points(second, {sequence_point(2, 9)}, {});
  for (const SearchPoint& point : of_second) EXPECT_THAT(of_first, Not(Contains(point)));
  EXPECT_EQ(next_points({18, 1}, {sequence_point(2, 0)}, {}).back(), of_second.back())
      << "both are parts of one sequence";
}

TEST(Search, FindsTheLeastInsideTheBoxAndInItsCorner) {
  for (const SearchPoint& least : {SearchPoint{0.27, 0.81, 0.4}, SearchPoint{1.0, 0.0, 1.0}}) {
    const auto searched = search(kBudget, {0.5, 0.5, 0.5}, distance_to(least));
    // The first round alone, 27 points, is 0.2 away.
    EXPECT_LT(searched[best_of(searched)].objective, 0.06);
  }
}

TEST(Search, FindsTheLeastOfFiveKeysThatDependOnEachOther) {
  const auto valley = [](const SearchPoint& p) {  // along the product of the first two
    return std::abs(p[0] * p[1] - 0.2) + std::abs(p[0] - 0.3) / 4 + std::abs(p[2] - 0.5) / 4 +
           std::abs(p[3] - 0.1) / 8 + std::abs(p[4] - 0.9) / 8;
  };
  const SearchPoint start(5, 0.5);
  const auto searched = search(kBudget, start, valley);
  EXPECT_LT(searched[best_of(searched)].objective, 0.35 * valley(start));
}

TEST(Search, StaysInTheBoxButForTheStart) {
  const auto searched = search(kBudget, {-3.0, 0.5}, distance_to({-1.0, 2.0}));
  for (std::size_t i = 1; i < searched.size(); ++i) {
    EXPECT_THAT(searched[i].point, Each(Ge(0.0)));
    EXPECT_THAT(searched[i].point, Each(Le(1.0)));
  }
  EXPECT_NEAR(searched[best_of(searched)].point[0], 0.0, 0.1);
}

TEST(Search, KeepsTheStartWhereNothingIsBetter) {
  const auto searched = search(kBudget, {0.37, 0.21}, distance_to({0.37, 0.21}));
  EXPECT_EQ(best_of(searched), 0U);
}

TEST(Search, TakesTheFirstOfEqualsAndNoneThatIsNoGood) {
  constexpr double kNoGood = std::numeric_limits<double>::infinity();
  EXPECT_EQ(best_of({{{0.1}, kNoGood}, {{0.2}, 3.0}, {{0.3}, 3.0}}), 1U);
  const auto searched = search(kBudget, {0.9}, [](const SearchPoint& point) {
    return point[0] > 0.4 ? kNoGood : 1.0 - point[0];
  });
  EXPECT_NEAR(searched[best_of(searched)].point[0], 0.4, 0.02);
}

TEST(Search, LooksAtNoPointTwice) {
  const auto searched = search(kBudget, {0.43, 0.21}, distance_to({0.9, 0.1}));
  for (std::size_t i = 0; i < searched.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) EXPECT_NE(searched[i].point, searched[j].point);
  }
}

TEST(Search, EndsAfterTheLastRound) {
  const auto searched = search({4, 2}, {0.5}, distance_to({0.3}));
  EXPECT_THAT(next_points({4, 2}, {{0.5}}, searched), IsEmpty());
}

}  // namespace
}  // namespace tether
