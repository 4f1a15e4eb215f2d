#include "sim/sensor/ray_caster.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "common/base/random.hpp"
#include "tests/support/ode_rays.hpp"

namespace tether {
namespace {

using std::numbers::pi;
using test::OdeRays;

constexpr double kHeight_m = 0.3;
constexpr double kFar_m = 1000.0;

Shape standing_box(double x_m, double y_m, double yaw_rad, double length_m, double width_m) {
  return {.pose = {x_m, y_m, yaw_rad}, .length_m = length_m, .width_m = width_m};
}

Shape cylinder(double x_m, double y_m, double radius_m) {
  return {.outline = Shape::Outline::circle, .pose = {x_m, y_m, 0.0}, .radius_m = radius_m};
}

/// `rays` all around from one point.
RayFan fan_at(double x_m, double y_m, int rays, double first_rad = -pi) {
  RayFan fan;
  for (int i = 0; i < rays; ++i) fan.add({x_m, y_m}, first_rad + 2.0 * pi * i / rays, 0.0);
  return fan;
}

/// A ray by itself.
RayFan ray(double x_m, double y_m, double angle_rad, double time_s = 0.0) {
  RayFan fan;
  fan.add({x_m, y_m}, angle_rad, time_s);
  return fan;
}

double range_m(const RayCaster& caster, RayFan fan, double max_m = kFar_m) {
  caster.cast(fan, max_m);
  return fan.range_m.at(0);
}

// ---------------------------------------------------------------------------- closed forms

TEST(RayCaster, SeesASquareHallFromItsMiddle) {
  const RayCaster caster({standing_box(0, 10.1, 0, 20.4, 0.2), standing_box(0, -10.1, 0, 20.4, 0.2),
                          standing_box(10.1, 0, 0, 0.2, 20), standing_box(-10.1, 0, 0, 0.2, 20)},
                         kHeight_m);
  RayFan fan = fan_at(0, 0, 720);
  caster.cast(fan, kFar_m);
  for (std::size_t i = 0; i < fan.size(); ++i) {
    const double straight = std::max(std::abs(fan.dx[i]), std::abs(fan.dy[i]));
    EXPECT_NEAR(fan.range_m[i], 10.0 / straight, 1e-9);
    EXPECT_NEAR(caster.hit(fan, i).cos_incidence, straight, 1e-9);
  }
}

TEST(RayCaster, SeesACircleFromOutsideAndInside) {
  Shape shape = cylinder(3, 0, 1);
  shape.reflectivity = 0.25;
  const RayCaster caster({shape}, kHeight_m);
  RayFan fan = ray(0, 0, std::asin(0.2));
  caster.cast(fan, kFar_m);
  // By the law of cosines.
  EXPECT_NEAR(fan.range_m[0], 3 * std::cos(std::asin(0.2)) - std::sqrt(1 - 0.36), 1e-12);
  EXPECT_NEAR(caster.hit(fan, 0).cos_incidence, 0.8, 1e-12);
  EXPECT_EQ(caster.hit(fan, 0).reflectivity, 0.25);
  EXPECT_EQ(range_m(caster, ray(0, 0, std::asin(0.34))), RayFan::kNothing);
  EXPECT_NEAR(range_m(caster, ray(3.5, 0, 0)), 0.5, 1e-12);
  EXPECT_NEAR(range_m(caster, ray(3.5, 0, pi)), 1.5, 1e-12);
}

TEST(RayCaster, SeesTheOutlineFromWithinABox) {
  const RayCaster caster({standing_box(1, 2, 0.5, 4, 2)}, kHeight_m);
  EXPECT_NEAR(range_m(caster, ray(1, 2, 0.5)), 2.0, 1e-12);
  EXPECT_NEAR(range_m(caster, ray(1, 2, 0.5 - pi / 2)), 1.0, 1e-12);
}

TEST(RayCaster, SeesNothingWhereNothingIs) {
  EXPECT_EQ(range_m(RayCaster({}, kHeight_m), ray(0, 0, 1)), RayFan::kNothing);
  RayFan none;
  RayCaster({standing_box(1, 2, 0.5, 4, 2)}, kHeight_m).cast(none, kFar_m);
  EXPECT_EQ(none.size(), 0U);
}

TEST(RayCaster, SeesUpToItsReach) {
  const RayCaster caster({standing_box(10, 0, 0, 2, 2)}, kHeight_m);
  EXPECT_EQ(range_m(caster, ray(0, 0, 0), 8.99), RayFan::kNothing);
  EXPECT_EQ(range_m(caster, ray(0, 0, 0), 9.01), 9.0);
}

TEST(RayCaster, SeesWhatItsHeightCuts) {
  Shape shelf = standing_box(5, 0, 0, 2, 2), pallet = standing_box(10, 0, 0, 2, 2);
  shelf.clearance_m = 0.4;
  shelf.height_m = 3.0;
  pallet.height_m = 0.35;
  EXPECT_EQ(range_m(RayCaster({shelf, pallet}, 0.3), ray(0, 0, 0)), 9.0);
  EXPECT_EQ(range_m(RayCaster({shelf, pallet}, 0.5), ray(0, 0, 0)), 4.0);
  EXPECT_EQ(range_m(RayCaster({pallet}, 0.5), ray(0, 0, 0)), RayFan::kNothing);
}

TEST(RayCaster, SeesWallsThatItAllButTouches) {
  const RayCaster caster({standing_box(0, 0.5, 0, 200, 1)}, kHeight_m);
  for (const double y_m : {-1e-12, -1e-9, -1e-6, -1e-3}) {
    RayFan fan = fan_at(0, y_m, 3600);
    caster.cast(fan, kFar_m);
    for (std::size_t i = 0; i < fan.size(); ++i) {
      const double towards_m = -y_m / fan.dy[i];
      const bool hits = fan.dy[i] > 1e-9 && std::abs(towards_m * fan.dx[i]) <= 100.0;
      EXPECT_EQ(fan.range_m[i] < kFar_m, hits) << y_m << " " << fan.angle_rad[i];
    }
  }
}

TEST(RayCaster, DoesNotLookIntoWhatItIsNotIn) {
  std::vector<Shape> rack{standing_box(5, 1, 0.3, 6, 1.1)};
  for (const double end : {-2.95, 0.0, 2.95}) {
    for (const double side : {-0.5, 0.5}) {
      rack.push_back(standing_box(5 + end * std::cos(0.3) - side * std::sin(0.3),
                                  1 + end * std::sin(0.3) + side * std::cos(0.3), 0.3, 0.1, 0.1));
    }
  }
  rack.push_back(cylinder(5, 1, 0.5));
  rack.push_back(cylinder(5, 1, 0.3));
  RayFan whole = fan_at(0, 0, 721), shelf = whole;
  RayCaster(rack, kHeight_m).cast(whole, kFar_m);
  RayCaster({rack[0]}, kHeight_m).cast(shelf, kFar_m);
  EXPECT_EQ(whole.range_m, shelf.range_m);
  EXPECT_EQ(whole.shape, shelf.shape);
  RayCaster({rack[0], rack[0]}, kHeight_m).cast(whole, kFar_m);
  EXPECT_EQ(whole.range_m, shelf.range_m) << "of two in one place, one is seen";
}

TEST(RayCaster, HasNoGapWhereSidesMeet) {
  const RayCaster caster({standing_box(5, 1, 0, 2, 2), standing_box(5, -1, 0, 2, 2)}, kHeight_m);
  EXPECT_EQ(range_m(caster, ray(0, 0, 0)), 4.0);
}

TEST(RayCaster, SeesShapesWhereTheyAreByThen) {
  RayCaster caster({standing_box(20, 0, 0, 2, 30)}, kHeight_m);
  Shape trolley = standing_box(10, 0, 0, 2, 2), person = cylinder(0, 8, 0.5);
  trolley.vx_mps = -2.0;
  person.vy_mps = 1.0;
  person.reflectivity = 0.1;
  caster.set_moving({trolley, person});
  EXPECT_NEAR(range_m(caster, ray(0, 0, 0, 0.5)), 8.0, 1e-12);
  RayFan fan;
  for (int i = 0; i <= 100; ++i) fan.add({0, 0}, 0.02 * i, 0.01 * i);
  caster.cast(fan, kFar_m);
  EXPECT_NEAR(fan.range_m[0], 9.0, 1e-12);
  EXPECT_NEAR(fan.range_m[2], (9.0 - 0.04) / std::cos(0.04), 1e-12);
  const auto up = static_cast<std::size_t>(std::lround(pi / 2 / 0.02));
  const double y_m = 8.0 + 0.01 * static_cast<double>(up);
  const double across_m = y_m * std::cos(fan.angle_rad[up]);
  const double half_m = std::sqrt(0.25 - across_m * across_m);
  EXPECT_NEAR(fan.range_m[up], y_m * std::sin(fan.angle_rad[up]) - half_m, 1e-9);
  EXPECT_EQ(caster.hit(fan, up).reflectivity, 0.1);
  EXPECT_NEAR(caster.hit(fan, up).cos_incidence, half_m / 0.5, 1e-9);
  caster.set_moving({});
  EXPECT_NEAR(range_m(caster, ray(0, 0, 0, 0.5)), 19.0, 1e-12);
}

// ---------------------------------------------------------------------------- against ODE's rays

/// 40 boxes and 20 cylinders of all sizes in a square of 40 m.
std::vector<Shape> random_hall(RandomEngine& random) {
  const auto within = [&](double low, double high) {
    return low + (high - low) * uniform_01(random);
  };
  std::vector<Shape> shapes;
  for (int i = 0; i < 60; ++i) {
    const double x_m = within(-20, 20), y_m = within(-20, 20);
    const double large_m = std::pow(10.0, within(-1.5, 1.0));
    shapes.push_back(i % 3 == 0
                         ? cylinder(x_m, y_m, 0.3 * large_m)
                         : standing_box(x_m, y_m, within(-pi, pi), large_m, within(0.05, 3)));
  }
  return shapes;
}

class AgainstOde : public ::testing::TestWithParam<int> {};

/// Each ray of a fan whose origin wanders, as of a fast vehicle that turns. Ranges to 1e-8 m: the
/// same numbers in another order, at up to 60 m.
TEST_P(AgainstOde, EachRayOfAMovingFanHasTheSameRange) {
  RandomEngine random = random_stream(7, "hall " + std::to_string(GetParam()));
  const std::vector<Shape> shapes = random_hall(random);
  const RayCaster caster(shapes, kHeight_m);
  OdeRays ode(shapes, kHeight_m);
  int rays = 0, met = 0, different = 0;
  for (int turn = 0; turn < 10; ++turn) {
    const double x_m = 40 * uniform_01(random) - 20, y_m = 40 * uniform_01(random) - 20;
    const double way_m = turn % 3 == 0 ? 0.0 : 0.3 * uniform_01(random);
    const double heading_rad = 2 * pi * uniform_01(random), fov_rad = turn % 2 == 0 ? 2 * pi : 4.7;
    const double turned_rad = 0.6 * uniform_01(random) - 0.3;
    RayFan fan;
    for (int i = 0; i < 541; ++i) {
      const double share = i / 541.0;
      fan.add({x_m + share * way_m * std::cos(heading_rad),
               y_m + share * way_m * std::sin(heading_rad)},
              heading_rad + share * (fov_rad + turned_rad * share), 0.0);
    }
    caster.cast(fan, 60.0);
    for (std::size_t i = 0; i < fan.size(); ++i, ++rays) {
      const auto hit = ode.cast(fan.x_m[i], fan.y_m[i], fan.dx[i], fan.dy[i], 60.0);
      met += std::isfinite(hit.range_m) ? 1 : 0;
      const bool same =
          hit.range_m == fan.range_m[i] || std::abs(hit.range_m - fan.range_m[i]) < 1e-8;
      different += same ? 0 : 1;
      if (same && std::isfinite(hit.range_m)) {
        EXPECT_NEAR(caster.hit(fan, i).cos_incidence, hit.cos_incidence, 1e-6);
      }
    }
  }
  EXPECT_EQ(different, 0);
  EXPECT_GT(met, rays / 4);
  RecordProperty("different", different);
}

INSTANTIATE_TEST_SUITE_P(RandomHalls, AgainstOde, ::testing::Range(0, 12));

}  // namespace
}  // namespace tether
