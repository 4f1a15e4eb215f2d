#include "common/world/shape.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/base/random.hpp"

namespace tether {
namespace {

constexpr double kQuarter = std::numbers::pi / 2.0;

Shape box(double x_m, double y_m, double yaw_rad, double length_m, double width_m) {
  return {.pose = {x_m, y_m, yaw_rad}, .length_m = length_m, .width_m = width_m};
}

Shape disc(double x_m, double y_m, double radius_m) {
  return {.outline = Shape::Outline::circle, .pose = {x_m, y_m, 0.0}, .radius_m = radius_m};
}

TEST(Shape, CornersGoRoundCounterClockwise) {
  const auto at = corners(box(1.0, 2.0, kQuarter, 4.0, 2.0));
  EXPECT_NEAR(at[0].x_m, 0.0, 1e-12);
  EXPECT_NEAR(at[0].y_m, 4.0, 1e-12);
  EXPECT_NEAR(at[1].x_m, 0.0, 1e-12);
  EXPECT_NEAR(at[1].y_m, 0.0, 1e-12);
  double area_m2 = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Position &a = at[i], &b = at[(i + 1) % 4];
    area_m2 += 0.5 * (a.x_m * b.y_m - a.y_m * b.x_m);
  }
  EXPECT_NEAR(area_m2, 8.0, 1e-12);
}

TEST(Shape, DistanceIsToTheOutlineAndNegativeInside) {
  const Shape b = box(0.0, 0.0, 0.0, 4.0, 2.0);
  EXPECT_DOUBLE_EQ(distance_m(b, {5.0, 0.5}), 3.0);
  EXPECT_DOUBLE_EQ(distance_m(b, {5.0, 5.0}), 5.0);
  EXPECT_DOUBLE_EQ(distance_m(b, {0.0, 0.0}), -1.0);
  EXPECT_DOUBLE_EQ(distance_m(disc(1.0, 0.0, 0.5), {1.0, 3.0}), 2.5);
  EXPECT_DOUBLE_EQ(distance_m(disc(1.0, 0.0, 0.5), {1.0, 0.2}), -0.3);
}

TEST(Shape, GapOfBoxesIsToTheNearestCornerOrSide) {
  const Shape a = box(0.0, 0.0, 0.0, 2.0, 2.0);
  EXPECT_NEAR(gap_m(a, box(4.0, 0.0, 0.0, 2.0, 2.0)), 2.0, 1e-12);
  EXPECT_NEAR(gap_m(a, box(5.0, 6.0, 0.0, 2.0, 2.0)), 5.0, 1e-12);
  EXPECT_NEAR(gap_m(a, box(3.0, 0.0, kQuarter / 2.0, 2.0, 2.0)), 2.0 - std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(gap_m(a, box(1.5, 0.2, 0.0, 2.0, 2.0)), -0.5, 1e-12);
  EXPECT_LT(gap_m(box(0.0, 0.0, 0.0, 10.0, 1.0), box(0.0, 0.0, kQuarter, 10.0, 1.0)), 0.0)
      << "no corner of a cross is within the other beam";
  EXPECT_NEAR(gap_m(disc(3.0, 4.0, 1.0), a), std::hypot(2.0, 3.0) - 1.0, 1e-12);
}

TEST(Shape, GapIsTheSameFromBothSidesAndNoLessThanThatOfAnyPoint) {
  RandomEngine random = random_stream(1, "shapes");
  const auto draw = [&](double low, double high) {
    return low + (high - low) * uniform_01(random);
  };
  for (int i = 0; i < 2000; ++i) {
    const Shape a = box(draw(-3, 3), draw(-3, 3), draw(-4, 4), draw(0.1, 4), draw(0.1, 4));
    const Shape b = box(draw(-3, 3), draw(-3, 3), draw(-4, 4), draw(0.1, 4), draw(0.1, 4));
    const double gap = gap_m(a, b);
    EXPECT_NEAR(gap, gap_m(b, a), 1e-12);
    double nearest_m = 1e9;
    for (int k = 0; k < 400; ++k) {
      const std::size_t side = k % 4;
      const double share = k / 400.0;
      const Position from = corners(b)[side], to = corners(b)[(side + 1) % 4];
      nearest_m = std::min(nearest_m, distance_m(a, {from.x_m + share * (to.x_m - from.x_m),
                                                     from.y_m + share * (to.y_m - from.y_m)}));
    }
    if (gap > 0.0) {
      EXPECT_LE(gap, nearest_m + 1e-12);
    }
    if (nearest_m < 0.0) {
      EXPECT_LT(gap, 0.0);
    }
  }
}

TEST(Shape, TheFootprintIsTheChassisAheadOfTheAxleAndTheWheelsAtIt) {
  const VehicleConfig vehicle;
  const auto [chassis, wheels] = footprint(vehicle, {1.0, 2.0, kQuarter});
  EXPECT_NEAR(chassis.pose.x_m, 1.0, 1e-12);
  EXPECT_NEAR(chassis.pose.y_m, 2.5, 1e-12);
  EXPECT_EQ(chassis.length_m, 2.0);
  EXPECT_EQ(wheels.pose.y_m, 2.0);
  EXPECT_NEAR(wheels.width_m, 1.4, 1e-12);
  EXPECT_EQ(wheels.length_m, 0.8);
}

}  // namespace
}  // namespace tether
