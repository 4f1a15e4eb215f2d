#include "tools/experiment/statistics/pareto.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/experiment/nan.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(ParetoFront, HasByAscendingXWhatNoOtherBeats) {
  EXPECT_THAT(pareto_front({{3, 1}, {1, 3}, {2, 4}, {2, 2}}), ElementsAre(1, 3, 0));
}

TEST(ParetoFront, OfOneIsThatOneAndOfNoneNone) {
  EXPECT_THAT(pareto_front({{7, 7}}), ElementsAre(0));
  EXPECT_THAT(pareto_front({}), IsEmpty());
}

TEST(ParetoFront, HasAllThatAreEqual) {
  EXPECT_THAT(pareto_front({{1, 2}, {2, 1}, {1, 2}}), ElementsAre(0, 2, 1));
}

TEST(ParetoFront, LeavesOutWhatIsAsGoodInOneAndWorseInTheOther) {
  EXPECT_THAT(pareto_front({{1, 2}, {1, 1}, {2, 1}}), ElementsAre(1));
}

TEST(ParetoFront, LeavesOutNaNWhichBeatsNothing) {
  EXPECT_THAT(pareto_front({{kNaN, 0}, {1, 1}, {0, kNaN}}), ElementsAre(1));
  EXPECT_THAT(pareto_front({{kNaN, kNaN}}), IsEmpty());
}

}  // namespace
}  // namespace tether
