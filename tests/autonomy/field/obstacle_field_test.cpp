#include "onboard/autonomy/obstacle_field.hpp"

#include <gtest/gtest.h>

#include "tests/autonomy/support/scanner.hpp"

namespace tether {
namespace {

using test::box;
using test::cylinder;
using test::hall;
using test::Scanner;

constexpr Twist kAhead{1.0, 0.0};
Instant seen_at_ms(int ms) { return kStart + std::chrono::milliseconds{ms}; }

/// 2 m long, 1.4 m wide with its wheels, 1.5 m ahead of the axle.
const VehicleConfig kVehicle;

class ObstacleFieldTest : public ::testing::Test {
 protected:
  void see(std::vector<Shape> shapes, const Pose2& vehicle = {}, const Twist& twist = {}) {
    for (const Shape& wall : hall(15.0)) shapes.push_back(wall);
    field_.see(scanner_.scan(seen_at_ms(0), vehicle, shapes), {}, twist);
    field_.update(seen_at_ms(0), Pose2{});
  }

  AutonomySettings settings_;
  Scanner scanner_{.mount = {1.4, 0.0, 0.0}};
  ObstacleField field_{settings_, kVehicle};
};

TEST(StoppingField, IsTheWayOfStoppingAndTheMargin) {
  const StoppingField field{AutonomySettings{}};
  EXPECT_DOUBLE_EQ(field.length_m(1.0), 0.5 + 0.2 + 0.3);
  EXPECT_DOUBLE_EQ(field.length_m(-1.0), field.length_m(1.0));
}

TEST(StoppingField, IsLongerWithWeakerBrakesAndASlowerReaction) {
  AutonomySettings settings;
  settings.deceleration_mps2 = 0.4;
  settings.reaction_s = 0.5;
  const StoppingField field{settings};
  EXPECT_DOUBLE_EQ(field.length_m(1.0), 1.25 + 0.5 + 0.3);
  EXPECT_DOUBLE_EQ(field.allowed_mps(1.25 + 0.5 + 0.3), 1.0);
}

TEST(StoppingField, TheAllowedSpeedIsThatWhoseFieldJustFits) {
  const StoppingField field{AutonomySettings{}};
  for (const double clear_m : {0.31, 0.5, 1.0, 4.0, 20.0}) {
    EXPECT_NEAR(field.length_m(field.allowed_mps(clear_m)), clear_m, 1e-9);
  }
  EXPECT_EQ(field.allowed_mps(0.3), 0.0);
  EXPECT_EQ(field.allowed_mps(0.0), 0.0);
}

TEST_F(ObstacleFieldTest, SeesHowFarItIsToABoxAhead) {
  see({box(6.0, 0.0, 1.0, 1.0)});
  EXPECT_NEAR(field_.clear_m(kAhead), 5.5 - 1.5, 0.01);
}

TEST_F(ObstacleFieldTest, ABoxBesideTheWayIsNoObstacle) {
  see({box(6.0, 1.5, 1.0, 1.0), box(6.0, -1.5, 1.0, 1.0)});  // gap of 2 m, way of 1.7 m
  EXPECT_NEAR(field_.clear_m(kAhead), 15.0 - 1.5, 0.01);
}

TEST_F(ObstacleFieldTest, TheSideMarginBelongsToTheWay) {
  see({box(6.0, 1.3, 1.0, 1.0)});  // its side at y = 0.8: beyond 0.7, within 0.7 + 0.15
  EXPECT_NEAR(field_.clear_m(kAhead), 4.0, 0.1);
}

TEST_F(ObstacleFieldTest, WhatIsOnTheStraightIsNotOnTheArc) {
  see({box(6.0, 0.0, 0.5, 0.5)});
  EXPECT_LT(field_.clear_m(kAhead), 5.0);
  EXPECT_GT(field_.clear_m({1.0, 0.5}), 5.0);
}

TEST_F(ObstacleFieldTest, AMapOfTheHallDoesNotMatter) {
  see({});
  EXPECT_NEAR(field_.clear_m(kAhead), 13.5, 0.01) << "the wall is an obstacle, too";
}

TEST_F(ObstacleFieldTest, ItsOwnOutlineIsNoObstacle) {
  see({cylinder(1.0, 0.3, 0.05)});  // a mast within the chassis
  EXPECT_NEAR(field_.clear_m(kAhead), 13.5, 0.01);
}

TEST_F(ObstacleFieldTest, BesideAWallThatIsNearerThanTheMarginTheMarginIsWhatThereIs) {
  see({box(2.5, 0.75 + 0.5, 7.0, 1.0)});  // 5 cm off
  EXPECT_GT(field_.clear_m(kAhead), 5.0) << "it drives along it";
  EXPECT_LT(field_.clear_m({0.5, 0.3}), 1.0) << "it does not turn into it";
  EXPECT_LT(field_.clear_m({1.0, 0.02}), 3.0) << "and comes no nearer";
}

TEST_F(ObstacleFieldTest, AScanMovesOnWithTheVehicle) {
  see({box(6.0, 0.0, 1.0, 1.0)});
  field_.update(seen_at_ms(100), Pose2{0.15, 0.0, 0.0});
  EXPECT_NEAR(field_.clear_m(kAhead), 4.0 - 0.15, 0.01);
}

TEST_F(ObstacleFieldTest, BeamsAreCorrectedForTheMotionDuringTheScan) {
  // 360 beams within 100 ms at 1.5 m/s: the one straight ahead is measured 50 ms before the end.
  Scan scan = scanner_.scan(seen_at_ms(0), {}, {box(6.0, 0.0, 1.0, 1.0)});
  scan.time_increment_s = 0.1 / 359.0;
  for (float& range : scan.range_m) range = range == 0.0F ? 20.0F : range;
  field_.see(scan, {}, {1.5, 0.0});
  field_.update(scan.end(), Pose2{});
  EXPECT_NEAR(field_.clear_m(kAhead), 4.0 - 0.075, 0.01);
}

TEST_F(ObstacleFieldTest, WithoutAScanNothingIsClear) {
  field_.update(seen_at_ms(0), Pose2{});
  EXPECT_EQ(field_.blind(), "no scan");
  EXPECT_EQ(field_.clear_m(kAhead), 0.0);
  EXPECT_FALSE(field_.is_way_free({{}}));
}

TEST_F(ObstacleFieldTest, AScanIsGoodForTheTimeOfReaction) {
  see({});
  field_.update(seen_at_ms(200), Pose2{});
  EXPECT_EQ(field_.blind(), "");
  field_.update(seen_at_ms(201), Pose2{});
  EXPECT_EQ(field_.blind(), "the newest scan is 201 ms old");
  EXPECT_EQ(field_.clear_m(kAhead), 0.0);
}

TEST_F(ObstacleFieldTest, AScanWithFewReturnsSaysNothing) {
  Scan scan = scanner_.scan(seen_at_ms(0), {}, hall(15.0));
  for (std::size_t i = 35; i < scan.range_m.size(); ++i) scan.range_m[i] = 0.0F;
  field_.see(scan, {}, {});
  field_.update(seen_at_ms(0), Pose2{});
  EXPECT_EQ(field_.blind(), "only 10 % of the scanner's beams return");
  EXPECT_EQ(field_.clear_m(kAhead), 0.0);
}

TEST_F(ObstacleFieldTest, WithoutOdometryAScanCannotBeMovedToThePresent) {
  see({});
  field_.update(seen_at_ms(10), std::nullopt);
  EXPECT_EQ(field_.blind(), "no odometry");
  EXPECT_EQ(field_.clear_m(kAhead), 0.0);
}

TEST_F(ObstacleFieldTest, ReversesOnlyWhereItsScannerLooks) {
  see({});
  EXPECT_GT(field_.clear_m({-0.3, 0.0}), 10.0);
  Scanner front{
      .mount = {1.4, 0.0, 0.0}, .beams = 270, .first_rad = -135.0 / 180.0 * std::numbers::pi};
  field_.see(front.scan(seen_at_ms(0), {}, hall(15.0)), {}, {});
  field_.update(seen_at_ms(0), Pose2{});
  EXPECT_EQ(field_.clear_m({-0.3, 0.0}), 0.0);
  EXPECT_GT(field_.clear_m(kAhead), 10.0);
}

TEST_F(ObstacleFieldTest, AWayAlongPosesIsFreeUnlessSomethingStandsInIt) {
  std::vector<Pose2> way;
  for (int i = 0; i < 30; ++i) way.push_back({0.1 * i, 0.0, 0.0});
  see({box(6.0, 0.0, 1.0, 1.0)});
  EXPECT_TRUE(field_.is_way_free(way));  // up to 2.9 + 1.5 m
  see({box(4.5, 0.0, 1.0, 1.0)});
  EXPECT_FALSE(field_.is_way_free(way));
}

}  // namespace
}  // namespace tether
