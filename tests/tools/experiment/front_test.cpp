#include "tools/experiment/sweep/front.hpp"

#include <gmock/gmock.h>

#include <cmath>

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// The worth of 100 runs.
Worth worth(std::size_t lost, double error) {
  Worth worth;
  worth.lost = lost;
  worth.n = 100;
  worth.survivors_error = error;
  return worth;
}

TEST(Front, HasWhatNoOtherCandidateBeatsInBoth) {
  EXPECT_THAT(front_of({worth(3, 0.1), worth(0, 0.5), worth(3, 0.2), worth(1, 0.6), worth(0, 0.5),
                        worth(9, 0.05)},
                       5),
              ElementsAre(1, 0, 5));
}

TEST(Front, KeepsItsEndsWhereItIsTooLong) {
  std::vector<Worth> all;
  for (std::size_t i = 0; i < 12; ++i)
    all.push_back(worth(i, 1.0 / (1.0 + static_cast<double>(i))));
  EXPECT_THAT(front_of(all, 2), ElementsAre(0, 11));
  const auto five = front_of(all, 5);
  EXPECT_EQ(five.size(), 5U);
  EXPECT_EQ(five.front(), 0U);
  EXPECT_EQ(five.back(), 11U);
}

/// Two conditions, 100 seeds; the second loses `lost` of them.
std::vector<std::vector<TunedRun>> runs(std::size_t lost) {
  std::vector<std::vector<TunedRun>> all(2);
  for (std::size_t seed = 0; seed < 100; ++seed) {
    const double error = 0.1 + 0.001 * static_cast<double>(seed % 10);
    all[0].push_back({error, false});
    all[1].push_back({4.0 * error, seed < lost});
  }
  return all;
}

TEST(Front, APointHasTheShareOfAllConditionsWithItsBoundAndTheOthersError) {
  const FrontPoint none = front_point("a", {}, {10.0, true}, runs(0));
  EXPECT_EQ(none.lost.n, 200U);
  EXPECT_EQ(none.lost.interval.low, 0.0);
  EXPECT_NEAR(none.lost.interval.high, 1.0 - std::pow(0.025, 1.0 / 200.0), 1e-9)
      << "Clopper-Pearson";
  EXPECT_NEAR(none.worth.survivors_error, std::sqrt(0.1045 * 0.418), 1e-12);
  EXPECT_TRUE(contains(none.error_interval, none.worth.survivors_error));
  // The two conditions move together: sd of a mean is 0.0029 / sqrt(100), times 2 of the 4.
  EXPECT_NEAR(half_width(none.error_interval), 1.96 * 2.0 * 0.00287 / 10.0, 2e-4);
  EXPECT_THAT(front_point("a", {}, {10.0, true}, runs(7)).worth.lost_by_condition,
              ElementsAre(0, 7));
}

TEST(Front, IsOneForAllLawsAndWrittenAsTables) {
  std::vector<FrontPoint> points{
      front_point("few, lost", {{"controller.trigger", "\"timer\""}}, {10.0, true}, runs(2)),
      front_point("many", {}, {10.0, true}, runs(50)),
      front_point("none", {}, {10.0, true}, runs(0))};
  points[0].worth.survivors_error = 0.1;
  points[1].worth.survivors_error = 0.1001;
  mark_front(points);
  EXPECT_TRUE(points[0].is_on_front);
  EXPECT_FALSE(points[1].is_on_front);
  EXPECT_TRUE(points[2].is_on_front);
  const std::string table = front_table(points, {"PRR 1", "PRR 0.2"});
  EXPECT_THAT(table, HasSubstr("| law | lost | PRR 1 | PRR 0.2 | error of the others | on the "
                               "front |\n|-|-|-|-|-|-|\n"));
  EXPECT_THAT(table, HasSubstr("| few, lost | 2/200 [0.121, 3.57] % | 0 | 2 | 0.1 ["));
  const std::string csv = front_csv(points, {"PRR 1", "PRR 0.2"});
  EXPECT_THAT(csv, HasSubstr("\"few, lost\",2,200,0.0012"));
  EXPECT_THAT(csv, HasSubstr("1,0,2,\"trigger timer\"\n"));
}

}  // namespace
}  // namespace tether
