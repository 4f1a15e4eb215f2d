#include "common/base/nearest_name.hpp"

#include <gtest/gtest.h>

namespace tether {
namespace {

TEST(NearestName, CountsLettersPutInTakenOutAndReplaced) {
  EXPECT_EQ(edit_distance("arm", "arm"), 0U);
  EXPECT_EQ(edit_distance("", "arm"), 3U);
  EXPECT_EQ(edit_distance("disarm", "arm"), 3U);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3U);
}

TEST(NearestName, IsTheFirstOfTheMostSimilarNames) {
  const std::vector<std::string> names{"arm", "disarm", "estop", "status"};
  EXPECT_EQ(nearest_name(names, "stauts"), "status");
  EXPECT_EQ(nearest_name(names, "disram"), "disarm");
  EXPECT_EQ(nearest_name(names, ""), "arm");
  EXPECT_EQ(nearest_name({"b", "a"}, "x"), "b");
}

}  // namespace
}  // namespace tether
