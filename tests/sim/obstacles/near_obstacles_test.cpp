#include "sim/plant/near_obstacles.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tether {
namespace {

constexpr double kNearStep_s = 1e-3, kSlack_m = 0.05;

Surroundings many(RandomEngine& random) {
  Surroundings hall;
  for (int i = 0; i < 60; ++i) {
    Obstacle o;
    if (i % 3 == 0) o.kind = Obstacle::Kind::cylinder;
    o.pose = {40.0 * uniform_01(random) - 20.0, 40.0 * uniform_01(random) - 20.0,
              6.0 * uniform_01(random)};
    o.length_m = i % 7 == 0 ? 8.0 : 1.0;
    o.width_m = 0.3;
    if (i % 10 == 0) {
      o.length_m = 1.0;
      o.to = {{40.0 * uniform_01(random) - 20.0, 40.0 * uniform_01(random) - 20.0}};
    }
    hall.obstacles.push_back(o);
  }
  return hall;
}

double gap_to_vehicle_m(const Pose2& axle, const Shape& shape) {
  const auto outline = footprint(VehicleConfig{}, axle);
  return std::min(gap_m(outline[0], shape), gap_m(outline[1], shape));
}

TEST(NearObstacles, AreAllThatTheVehicleCanTouchInAStepAndNothingFar) {
  RandomEngine random = random_stream(1, "hall");
  const Surroundings hall = many(random);
  const WorldSettings world;
  NearObstacles obstacles({}, world, hall, 1, kNearStep_s, kSlack_m);
  MovingObstacles moving(hall, 1);
  const std::vector<Shape> standing = solid_shapes(hall);
  Pose2 pose;
  int found = 0;
  for (int i = 0; i < 60'000; ++i) {
    const double t_s = i * kNearStep_s;
    pose.x_m = 18.0 * std::sin(0.31 * t_s);
    pose.y_m = 18.0 * std::sin(0.17 * t_s + 1.0);
    pose.yaw_rad = wrap_angle(2.0 * std::sin(1.3 * t_s));
    const auto near = obstacles.near(pose, t_s);
    if (i % 5 != 0 && near.empty()) continue;  // all of them take long
    std::size_t expected = 0;
    const auto count = [&](const Shape& shape) {
      const double gap = gap_to_vehicle_m(pose, shape);
      if (gap <= kSlack_m) ++expected;
    };
    for (const Shape& shape : standing) count(shape);
    for (const Shape& shape : moving.at(t_s)) count(shape);
    ASSERT_GE(near.size(), expected) << t_s;
    for (const Shape& shape : near) ASSERT_LT(gap_to_vehicle_m(pose, shape), kSlack_m + 0.1);
    found += static_cast<int>(expected);
  }
  EXPECT_GT(found, 1000);
}

TEST(NearObstacles, OfAnEmptyHallAreNone) {
  NearObstacles obstacles({}, {}, {}, 1, kNearStep_s, kSlack_m);
  EXPECT_TRUE(obstacles.near({}, 0.0).empty());
}

TEST(NearObstacles, AreFoundFromPlacesBeyondTheWalls) {
  Surroundings hall;
  hall.obstacles.push_back({.pose = {21.0, 21.0, 0.0}});
  NearObstacles obstacles({}, {}, hall, 1, kNearStep_s, kSlack_m);
  EXPECT_EQ(obstacles.near({22.0, 22.0, 0.0}, 0.0).size(), 1u);
  EXPECT_TRUE(obstacles.near({-50.0, 0.0, 0.0}, 0.0).empty());
}

}  // namespace
}  // namespace tether
