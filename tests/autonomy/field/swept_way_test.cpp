#include "onboard/autonomy/swept_way.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "common/base/random.hpp"

namespace tether {
namespace {

constexpr Outline kSweptOutline{-0.5, 1.5, 0.6};
constexpr double kNever_m = std::numeric_limits<double>::infinity();

TEST(SweptWay, StraightAheadItIsTheWayToTheFront) {
  EXPECT_DOUBLE_EQ(way_until_m({4.0, 0.59}, kSweptOutline, {1.0, 0.0}), 2.5);
  EXPECT_DOUBLE_EQ(way_until_m({-2.0, 0.0}, kSweptOutline, {-0.3, 0.0}), 1.5);
}

TEST(SweptWay, WhatIsBesideOrBehindIsNeverMet) {
  EXPECT_EQ(way_until_m({4.0, 0.61}, kSweptOutline, {1.0, 0.0}), kNever_m);
  EXPECT_EQ(way_until_m({-2.0, 0.0}, kSweptOutline, {1.0, 0.0}), kNever_m);
}

TEST(SweptWay, AVehicleThatStandsMeetsNothing) {
  EXPECT_EQ(way_until_m({1.6, 0.0}, kSweptOutline, {}), kNever_m);
}

TEST(SweptWay, ATurnOnTheSpotMeetsWhatItsCornersReach) {
  // A point straight to the left of the axle, nearer than the corner: the left side comes round to
  // it with its place at that distance.
  const double way_m = way_until_m({0.0, 1.55}, kSweptOutline, {0.0, 0.5});
  const double angle = std::numbers::pi / 2.0 - std::asin(0.6 / 1.55);
  EXPECT_NEAR(way_m, angle * kSweptOutline.reach_m(), 1e-12);
  EXPECT_EQ(way_until_m({0.0, 1.63}, kSweptOutline, {0.0, 0.5}), kNever_m);
}

/// Moves the outline in small steps until it contains the point.
double stepped_way_m(const Position& p, const Twist& twist, double step_m, double most_m) {
  const double pace = pace_mps(twist, kSweptOutline);
  for (double way = 0.0; way < most_m; way += step_m) {
    if (kSweptOutline.contains(into_frame(moved({}, twist, way / pace), p))) return way;
  }
  return kNever_m;
}

TEST(SweptWay, AgreesWithTheOutlineMovedStepByStep) {
  RandomEngine random = random_stream(7, "swept_way_test");
  const auto between = [&random](double a, double b) { return a + (b - a) * uniform_01(random); };
  constexpr double kStep_m = 2e-3, kMost_m = 8.0;
  int met = 0;
  for (int i = 0; i < 1000; ++i) {
    const Position p{between(-4.0, 6.0), between(-4.0, 4.0)};
    const Twist twist{i % 5 == 0 ? 0.0 : between(-1.5, 1.5), i % 7 == 0 ? 0.0 : between(-1.0, 1.0)};
    if (kSweptOutline.contains(p) || pace_mps(twist, kSweptOutline) == 0.0) continue;
    const double stepped = stepped_way_m(p, twist, kStep_m, kMost_m);
    const double exact = way_until_m(p, kSweptOutline, twist);
    if (std::isinf(stepped)) {
      // A corner that is grazed for less than a step is all that steps may miss.
      if (exact < kMost_m) {
        const Pose2 then = moved({}, twist, (exact + kStep_m) / pace_mps(twist, kSweptOutline));
        EXPECT_FALSE(kSweptOutline.contains(into_frame(then, p))) << i;
      }
      continue;
    }
    ++met;
    EXPECT_LE(exact, stepped + 1e-9) << i;
    EXPECT_GE(exact, stepped - kStep_m - 1e-9) << i;
  }
  EXPECT_GT(met, 100);
}

TEST(SweptWay, WhatIsInsideTheOutlineLeavesNoWay) {
  for (const Twist& twist : {Twist{1.0, 0.0}, Twist{-1.0, 0.0}, Twist{1.0, 0.5}, Twist{0.0, 1.0}}) {
    EXPECT_EQ(way_until_m({0.3, 0.2}, kSweptOutline, twist), 0.0);
  }
}

TEST(SweptWay, AFreeWayIsFreeAtEachPose) {
  const std::vector<Pose2> way{{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {2.0, 0.0, 0.0}};
  EXPECT_TRUE(is_free({{3.6, 0.0}, {1.0, 0.7}}, kSweptOutline, way));
  EXPECT_FALSE(is_free({{3.4, 0.0}}, kSweptOutline, way));
}

}  // namespace
}  // namespace tether
