#include "onboard/localiser/odometry_track.hpp"

#include <gtest/gtest.h>

namespace tether {
namespace {

Instant at_ms(int ms) { return kStart + std::chrono::milliseconds{ms}; }

OdometryReading reading(int ms, const Pose2& pose, double distance_m, const Twist& twist = {}) {
  return {at_ms(ms), pose, distance_m, twist};
}

TEST(OdometryTrack, KnowsNothingBeforeTheFirstReading) {
  EXPECT_FALSE(OdometryTrack().at(kStart).has_value());
}

TEST(OdometryTrack, IsStraightBetweenReadingsEvenAcrossTheJumpOfTheAngle) {
  OdometryTrack track;
  track.add(reading(0, {1.0, 2.0, 3.1}, 5.0));
  track.add(reading(100, {2.0, 2.0, -3.1}, 6.0));
  const auto middle = *track.at(at_ms(25));
  EXPECT_NEAR(middle.pose.x_m, 1.25, 1e-12);
  EXPECT_NEAR(middle.pose.yaw_rad, 3.1 + 0.25 * (2.0 * std::numbers::pi - 6.2), 1e-12);
  EXPECT_NEAR(middle.distance_m, 5.25, 1e-12);
  EXPECT_EQ(middle.beyond_s, 0.0);
}

TEST(OdometryTrack, GoesOnAlongTheLastTwistAndStoodBefore) {
  OdometryTrack track;
  track.add(reading(1000, {0.0, 0.0, 0.0}, 0.0, {1.0, 0.2}));
  const auto later = *track.at(at_ms(1100));
  EXPECT_NEAR(later.pose.x_m, 0.1, 1e-4);
  EXPECT_NEAR(later.pose.y_m, 0.001, 1e-5);
  EXPECT_NEAR(later.pose.yaw_rad, 0.02, 1e-12);
  EXPECT_NEAR(later.beyond_s, 0.1, 1e-12);
  const auto before = *track.at(at_ms(400));
  EXPECT_EQ(before.pose.x_m, 0.0);
  EXPECT_NEAR(before.beyond_s, 0.6, 1e-12);
}

TEST(OdometryTrack, ForgetsAllBeforeWheelsThatWereSetToAnotherPose) {
  OdometryTrack track;
  EXPECT_TRUE(track.add(reading(0, {5.0, 0.0, 0.0}, 3.0)));
  EXPECT_TRUE(track.add(reading(20, {5.02, 0.0, 0.0}, 3.02)));
  EXPECT_FALSE(track.add(reading(40, {0.0, 0.0, 0.0}, 0.0)));
  EXPECT_EQ(track.at(at_ms(10))->pose.x_m, 0.0);
}

TEST(OdometryTrack, KeepsAllThatItsMemoryIsFor) {
  OdometryTrack track;
  for (int i = 0; i <= 2000; ++i) track.add(reading(20 * i, {0.01 * i, 0.0, 0.0}, 0.01 * i));
  EXPECT_NEAR(track.at(at_ms(30'010))->pose.x_m, 15.005, 1e-9);
  EXPECT_GT(track.at(at_ms(1000))->beyond_s, 20.0);  // forgotten
}

}  // namespace
}  // namespace tether
