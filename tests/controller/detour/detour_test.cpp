#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "common/base/random.hpp"
#include "common/vehicle/motion_model.hpp"
#include "controller/detour/detour_driver.hpp"

namespace tether {
namespace {

/// 2 m long, 1.4 m wide, 1.5 m ahead of the axle.
const VehicleConfig kVehicle;
const DetourPlanner::Config kConfig;

Shape box(double x_m, double y_m, double length_m, double width_m, double yaw_rad = 0.0) {
  Shape shape;
  shape.pose = {x_m, y_m, yaw_rad};
  shape.length_m = length_m;
  shape.width_m = width_m;
  return shape;
}

/// The nearest that any of the shapes comes to the vehicle.
double clearance_m(const Pose2& pose, const std::vector<Shape>& shapes) {
  double least_m = 1e9;
  for (const Shape& part : footprint(kVehicle, pose)) {
    for (const Shape& shape : shapes) least_m = std::min(least_m, gap_m(part, shape));
  }
  return least_m;
}

/// y = 0, at 1.5 m/s.
class Line final : public ReferencePath {
 public:
  PathPoint at(double t_s) const override {
    const double t = std::clamp(t_s, 0.0, 40.0);
    return {1.5 * t, 0.0, 0.0, t_s < 0.0 || t_s > 40.0 ? 0.0 : 1.5, 0.0};
  }
};

TEST(FloorMap, IsExactAtCellsCentresAndKnowsNothingBeyondItsSquare) {
  FloorMap floor({0.0, 0.0}, 5.0);
  floor.add(box(1.0, 0.0, 1.0, 1.0));
  floor.add(Position{-2.0, -2.0});
  EXPECT_NEAR(floor.distance_m({0.15, 0.05}), 0.35, 1e-6);
  EXPECT_NEAR(floor.distance_m({-2.05, -1.55}), std::hypot(0.05, 0.45), 1e-6);
  EXPECT_LT(floor.distance_m({1.0, 0.0}), 0.0);
  EXPECT_EQ(floor.distance_m({-4.0, 4.0}), FloorMap::kFar_m);
  EXPECT_EQ(floor.distance_m({5.1, 0.0}), -FloorMap::kFar_m);
}

TEST(DetourPlanner, GoesAroundABoxAndKeepsItsDistance) {
  const std::vector<Shape> shapes{box(3.0, 0.0, 1.0, 1.0)};
  FloorMap floor({0.0, 0.0}, 16.0);
  for (const Shape& shape : shapes) floor.add(shape);
  const DetourPlanner planner(kConfig);
  const auto way = planner.plan(floor, {}, {{8.0, 0.0, 0.0}});
  ASSERT_TRUE(way);
  for (const Pose2& pose : *way) EXPECT_GT(clearance_m(pose, shapes), kConfig.side_m - 0.05);
  EXPECT_NEAR(way->back().x_m, 8.0, 0.2);
  EXPECT_NEAR(way->back().y_m, 0.0, 0.2);
  EXPECT_LT(planner.expansions(), 20'000);
}

TEST(DetourPlanner, FindsNoWayThroughAWall) {
  FloorMap floor({0.0, 0.0}, 16.0);
  floor.add(box(4.0, 0.0, 0.2, 40.0));
  const DetourPlanner planner(kConfig);
  EXPECT_FALSE(planner.plan(floor, {}, {{8.0, 0.0, 0.0}}));
  EXPECT_LE(planner.expansions(), DetourPlanner::kMostExpansions);
}

TEST(DetourPlanner, TheSameQuestionHasTheSameAnswer) {
  FloorMap floor({0.0, 0.0}, 16.0);
  floor.add(box(3.5, 0.3, 1.0, 2.0, 0.4));
  const DetourPlanner planner(kConfig);
  const auto a = planner.plan(floor, {}, {{9.0, 0.0, 0.0}});
  const auto b = planner.plan(floor, {}, {{9.0, 0.0, 0.0}});
  ASSERT_TRUE(a && b);
  ASSERT_EQ(a->size(), b->size());
  for (std::size_t i = 0; i < a->size(); ++i) {
    EXPECT_EQ((*a)[i].x_m, (*b)[i].x_m);
    EXPECT_EQ((*a)[i].yaw_rad, (*b)[i].yaw_rad);
  }
}

/// Drives a vehicle whose wheels have limits, with poses and commands `delay_s` late in sum;
/// returns the least gap to the shapes on the way, and where it ends.
struct Drive {
  double least_m = 1e9;
  Pose2 end;
  double took_s = 0.0;
};

Drive drive_around(const std::vector<Shape>& shapes, double delay_s) {
  AutonomySettings autonomy;
  DetourDriver driver(autonomy, kVehicle, std::make_shared<Line>(), PathLimits{}, {});
  driver.begin();
  std::vector<Position> points;
  for (const Shape& shape : shapes) {
    const double x = shape.pose.x_m, y = shape.pose.y_m;
    const double half_x = 0.5 * shape.length_m, half_y = 0.5 * shape.width_m;
    for (double w = -half_y; w <= half_y; w += 0.1) points.push_back({x - half_x, y + w});
    for (double l = -half_x; l <= half_x; l += 0.1) {
      points.push_back({x + l, y + half_y});
      points.push_back({x + l, y - half_y});
    }
  }
  const MotionModel model({kVehicle.track_m, kVehicle.max_wheel_acceleration_mps2, 10.0});
  MotionModel::State state;
  constexpr double kStep_s = 0.05;
  std::vector<Twist> sent(static_cast<std::size_t>(delay_s / kStep_s) + 1);
  Drive drive;
  for (int i = 0; i < 2000; ++i) {
    const Instant now = kStart + from_seconds(i * kStep_s);
    if (i % 2 == 0) driver.see(now, points, 0.0);
    sent.push_back(driver.drive(now, state.pose));
    model.advance(state, sent.front(), kStep_s);
    sent.erase(sent.begin());
    drive.least_m = std::min(drive.least_m, clearance_m(state.pose, shapes));
    if (!driver.way().empty() && state.pose.x_m > shapes.back().pose.x_m + 2.0 &&
        std::abs(state.pose.y_m) < 0.25 && std::abs(state.pose.yaw_rad) < 0.3) {
      drive.took_s = i * kStep_s;
      break;
    }
  }
  drive.end = state.pose;
  return drive;
}

TEST(DetourDriver, TakesTheVehicleAroundABoxAndBackOntoThePath) {
  const Drive drive = drive_around({box(2.31, 0.0, 1.0, 1.0)}, 0.0);
  EXPECT_GT(drive.took_s, 0.0) << drive.end.x_m << " " << drive.end.y_m;
  EXPECT_LT(drive.took_s, 60.0);
  EXPECT_GT(drive.least_m, 0.15);
}

TEST(DetourDriver, DoesSoWhenTheRoundTripTakesHalfASecond) {
  const Drive drive = drive_around({box(2.31, 0.0, 1.0, 1.0)}, 0.5);
  EXPECT_GT(drive.took_s, 0.0) << drive.end.x_m << " " << drive.end.y_m;
  EXPECT_GT(drive.least_m, 0.05);
}

TEST(DetourDriver, StandsWhereThereIsNoWay) {
  const Drive drive = drive_around({box(2.4, 0.0, 0.4, 40.0)}, 0.0);
  EXPECT_EQ(drive.took_s, 0.0);
  EXPECT_EQ(drive.end.x_m, 0.0);
}

TEST(ObstacleMemory, RemembersObstaclesThatAreNotSeenAnyMoreUntilForgetIsCalled) {
  ObstacleMemory memory;
  memory.add(kStart, {{1.0, 1.0}});
  memory.add(kStart + std::chrono::seconds{5}, {{3.0, 1.0}, {3.01, 1.0}});
  EXPECT_EQ(memory.points().size(), 2U);
  memory.forget_before(kStart + std::chrono::seconds{1});
  ASSERT_EQ(memory.points().size(), 1U);
  EXPECT_NEAR(memory.points().front().x_m, 3.0, 1e-9);
}

TEST(PathPlaces, AreKnownByArcLength) {
  PathPlaces places(std::make_shared<Line>());
  const std::vector<Pose2> poses = places.poses(10.0, 5.0);
  EXPECT_NEAR(poses.front().x_m, 10.0, 0.1);
  EXPECT_NEAR(poses.back().x_m, 15.0, 0.15);
  EXPECT_FALSE(places.ends_by(59.0));
  EXPECT_TRUE(places.ends_by(61.0));
}

}  // namespace
}  // namespace tether
