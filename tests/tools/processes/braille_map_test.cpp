#include <gmock/gmock.h>

#include <limits>
#include <numbers>

#include "tools/nodes/dashboard.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

TEST(BrailleMap, IsBlankAtFirst) {
  EXPECT_THAT(BrailleMap(2, 1.0).lines(), ElementsAre("    ", "    "));
}

TEST(BrailleMap, PutsNorthUpAndEastRight) {
  BrailleMap map(1, 4.0);  // dots of 2 m, two cells
  map.bright_dot(-3.9, 3.9);
  map.bright_dot(3.9, -3.9);
  EXPECT_THAT(map.lines(), ElementsAre("⠁⢀"));
}

TEST(BrailleMap, LeavesOutWhatIsBeyondTheEdge) {
  BrailleMap map(1, 4.0);
  map.bright_dot(4.0, 0.0);  // the first that is not inside
  map.bright_dot(0.0, -4.1);
  map.bright_dot(std::numeric_limits<double>::quiet_NaN(), 0.0);
  EXPECT_THAT(map.lines(), ElementsAre("  "));
}

TEST(BrailleMap, KeepsACellBrightThatIsBrightAnywhere) {
  BrailleMap map(1, 4.0);
  map.faint_dot(-3.9, 3.9);
  map.faint_dot(3.9, -3.9);
  map.bright_dot(2.1, 3.9);
  map.faint_dot(2.1, 1.9);
  EXPECT_THAT(map.lines(), ElementsAre("\033[2m⠁\033[0m⢘"));
}

TEST(BrailleMap, PointsAnArrowInTheNearestOfEightDirections) {
  const auto arrow = [](double yaw_rad) {
    BrailleMap map(1, 4.0);
    map.arrow(1.0, 0.0, yaw_rad);
    return map.lines().front();
  };
  EXPECT_THAT(arrow(0.0), " \033[1m→\033[0m");
  EXPECT_THAT(arrow(kPi / 2), HasSubstr("↑"));
  EXPECT_THAT(arrow(kPi), HasSubstr("←"));
  EXPECT_THAT(arrow(-kPi), HasSubstr("←"));
  EXPECT_THAT(arrow(-kPi / 4), HasSubstr("↘"));
  EXPECT_THAT(arrow(kPi / 8 - 0.01), HasSubstr("→"));
  EXPECT_THAT(arrow(kPi / 8 + 0.01), HasSubstr("↗"));
  EXPECT_THAT(arrow(2 * kPi + 0.1), HasSubstr("→"));
}

TEST(BrailleMap, ShowsAnArrowAtTheEdgeWhenItIsBeyond) {
  BrailleMap map(1, 4.0);
  map.arrow(-1e300, 7.0, 0.0);
  EXPECT_THAT(map.lines(), ElementsAre("\033[1m→\033[0m "));
}

}  // namespace
}  // namespace tether
