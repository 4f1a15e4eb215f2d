#include <gtest/gtest.h>
#include <ode/ode.h>

#include <cmath>
#include <numbers>

#include "common/base/random.hpp"
#include "sim/plant/near_obstacles.hpp"

namespace tether {
namespace {

Shape box(double x_m, double y_m, double yaw_rad, double length_m, double width_m) {
  return {.pose = {x_m, y_m, yaw_rad}, .length_m = length_m, .width_m = width_m};
}

Shape disc(double x_m, double y_m, double radius_m) {
  return {.outline = Shape::Outline::circle, .pose = {x_m, y_m, 0.0}, .radius_m = radius_m};
}

class Draw {
 public:
  double between(double low, double high) { return low + (high - low) * uniform_01(random_); }
  Shape any_box() {
    return box(between(-3, 3), between(-3, 3), between(-4, 4), between(0.1, 4), between(0.1, 4));
  }
  Shape any_disc() { return disc(between(-3, 3), between(-3, 3), between(0.1, 2)); }

 private:
  RandomEngine random_ = random_stream(1, "touch");
};

TEST(Touch, OfASideOnASideHasTheEndsOfWhatTheyShare) {
  const Touch t = touch(box(0, 0, 0, 2, 2), box(2.5, 1.5, 0, 2, 4));
  ASSERT_EQ(t.points().size(), 2u);
  double low = 9.0, high = -9.0;
  EXPECT_DOUBLE_EQ(t.gap_m(), 0.5);
  EXPECT_DOUBLE_EQ(t.normal().x_m, 1.0);
  EXPECT_NEAR(t.normal().y_m, 0.0, 1e-12);
  for (const Touch::Point& p : t.points()) {
    EXPECT_DOUBLE_EQ(p.gap_m, 0.5);
    low = std::min(low, p.at.y_m);
    high = std::max(high, p.at.y_m);
  }
  EXPECT_NEAR(low, -0.5, 1e-12);
  EXPECT_NEAR(high, 1.0, 1e-12);
}

TEST(Touch, OfACornerIsThere) {
  const Touch t = touch(box(0, 0, 0, 2, 2), box(2.5, 0.2, std::numbers::pi / 4.0, 2, 2));
  const auto nearest = std::ranges::min(t.points(), {}, &Touch::Point::gap_m);
  EXPECT_NEAR(nearest.at.x_m, 2.5 - std::numbers::sqrt2, 1e-12);
  EXPECT_NEAR(nearest.at.y_m, 0.2, 1e-12);
  EXPECT_NEAR(nearest.gap_m, t.gap_m(), 1e-12);
  EXPECT_NEAR(t.gap_m(), 1.5 - std::numbers::sqrt2, 1e-12);
}

TEST(Touch, OfACircleIsOnTheLineThroughItsCentre) {
  const Touch t = touch(box(0, 0, 0, 2, 2), disc(4, 5, 2));
  ASSERT_EQ(t.points().size(), 1u);
  EXPECT_DOUBLE_EQ(t.gap_m(), 3.0);
  EXPECT_DOUBLE_EQ(t.normal().x_m, 0.6);
  EXPECT_DOUBLE_EQ(t.points()[0].at.x_m, 1.0);
  const Touch inside = touch(box(0, 0, 0, 4, 2), disc(0.5, 0.9, 0.3));
  EXPECT_DOUBLE_EQ(inside.normal().y_m, 1.0);
  EXPECT_NEAR(inside.gap_m(), -0.4, 1e-12);
}

TEST(Touch, GapIsThatOfTheShapesOrUpToRootTwoSmallerBetweenCorners) {
  Draw draw;
  for (int i = 0; i < 5000; ++i) {
    const Shape a = draw.any_box();
    const Shape b = i % 2 == 0 ? draw.any_box() : draw.any_disc();
    const double gap = gap_m(a, b), touch_gap = touch(a, b).gap_m();
    if (gap > 0.0) {
      EXPECT_LE(touch_gap, gap + 1e-12);
      EXPECT_GE(touch_gap, gap / std::numbers::sqrt2 - 1e-12);
    }
  }
}

TEST(Touch, MovedOutAlongItsNormalThereIsNoOverlapLeft) {
  Draw draw;
  int overlapping = 0;
  for (int i = 0; i < 5000; ++i) {
    Shape a = draw.any_box();
    const Shape b = i % 2 == 0 ? draw.any_box() : draw.any_disc();
    if (gap_m(a, b) >= 0.0) continue;
    ++overlapping;
    const Touch nearest = touch(a, b);
    ASSERT_LT(nearest.gap_m(), 0.0);
    a.pose.x_m += nearest.gap_m() * nearest.normal().x_m;
    a.pose.y_m += nearest.gap_m() * nearest.normal().y_m;
    EXPECT_NEAR(gap_m(a, b), 0.0, 1e-9);
  }
  EXPECT_GT(overlapping, 1000);
}

// ODE's box and cylinder colliders, of boxes so high that nothing comes out above or below.
TEST(Touch, OverlapsAsDeepAndInTheSameDirectionAsOdeHasThem) {
  dInitODE2(0);
  dAllocateODEDataForThread(dAllocateMaskAll);
  const auto place = [](dGeomID geom, const Shape& s) {
    dMatrix3 r;
    dRFromAxisAndAngle(r, 0, 0, 1, s.pose.yaw_rad);
    dGeomSetRotation(geom, r);
    dGeomSetPosition(geom, s.pose.x_m, s.pose.y_m, 0.0);
    return geom;
  };
  Draw draw;
  int compared = 0;
  for (int i = 0; i < 4000; ++i) {
    const Shape a = draw.any_box(), b = draw.any_box();
    const dGeomID first = place(dCreateBox(nullptr, a.length_m, a.width_m, 100.0), a);
    const dGeomID second = place(dCreateBox(nullptr, b.length_m, b.width_m, 100.0), b);
    dContactGeom points[8];
    const int count = dCollide(first, second, 8, points, sizeof(dContactGeom));
    const double gap = gap_m(a, b);
    EXPECT_EQ(count > 0, gap <= 0.0);
    double deepest = 0.0;
    for (int k = 0; k < count; ++k) deepest = std::max(deepest, points[k].depth);
    if (count > 0) {
      const Touch nearest = touch(a, b);
      EXPECT_NEAR(nearest.gap_m(), -deepest, 1e-9);
      // ODE's normal points into its first geom.
      EXPECT_NEAR(nearest.normal().x_m, -points[0].normal[0], 1e-9);
      EXPECT_NEAR(nearest.normal().y_m, -points[0].normal[1], 1e-9);
      ++compared;
    }
    dGeomDestroy(first);
    dGeomDestroy(second);
  }
  EXPECT_GT(compared, 1000);
}

}  // namespace
}  // namespace tether
