#include "onboard/localiser/pose_tracker.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tether {
namespace {

constexpr PoseTracker::Settings kSettings{1.0, 0.01};

PoseCovariance sure(double m, double rad) { return {m * m, 0.0, 0.0, m * m, 0.0, rad * rad}; }

Match match_at(const Pose2& pose, const PoseInformation& information) {
  Match match;
  match.pose = pose;
  match.information = information;
  return match;
}

OdometryTrack::Point point(const Pose2& pose, double distance_m, double beyond_s = 0.0) {
  return {pose, distance_m, beyond_s};
}

TEST(PoseTracker, IsTheMeanOfWhatItKnowsAndAMatchByTheirVariances) {
  PoseTracker tracker(kSettings, {0.0, 0.0, 0.0}, sure(0.1, 0.1));
  ASSERT_TRUE(tracker.correct(match_at({0.1, 0.2, 0.1}, {100.0, 0.0, 0.0, 300.0, 0.0, 100.0})));
  EXPECT_NEAR(tracker.pose().x_m, 0.05, 1e-8);
  EXPECT_NEAR(tracker.pose().y_m, 0.15, 1e-8);
  EXPECT_NEAR(tracker.covariance().x_x, 0.005, 1e-9);
  EXPECT_NEAR(tracker.covariance().y_y, 0.0025, 1e-9);
  // νᵀ S⁻¹ ν with S = P + Λ⁻¹
  EXPECT_NEAR(tracker.last_nis(), 0.01 / 0.02 + 0.04 / (0.01 + 1.0 / 300.0) + 0.01 / 0.02, 1e-7);
}

TEST(PoseTracker, TakesNothingFromAMatchWhereItSaysNothing) {
  PoseTracker tracker(kSettings, {0.0, 0.0, 0.0}, sure(0.1, 0.1));
  // Along 45° the information is singular; the match is off by a metre there.
  ASSERT_TRUE(tracker.correct(match_at({0.7, 0.7, 0.0}, {5e3, -5e3, 0.0, 5e3, 0.0, 1e4})));
  EXPECT_NEAR(tracker.pose().x_m, 0.0, 1e-9);
  EXPECT_NEAR(tracker.pose().y_m, 0.0, 1e-9);
  const PoseCovariance& p = tracker.covariance();
  EXPECT_NEAR(0.5 * (p.x_x + p.y_y) + p.x_y, 0.01, 1e-9);           // along: as before
  EXPECT_NEAR(0.5 * (p.x_x + p.y_y) - p.x_y, 1.0 / 10100.0, 1e-9);  // across: known
}

TEST(PoseTracker, DoesNotUseAMatchThatIsFarFromWhatItKnows) {
  PoseTracker tracker(kSettings, {0.0, 0.0, 0.0}, sure(0.01, 0.01));
  EXPECT_FALSE(tracker.correct(match_at({0.5, 0.0, 0.0}, {1e4, 0.0, 0.0, 1e4, 0.0, 1e4})));
  EXPECT_EQ(tracker.pose().x_m, 0.0);
  EXPECT_GT(tracker.last_nis(), PoseTracker::kGate);
}

TEST(PoseTracker, TakesTheShortWayRoundTheCircle) {
  PoseTracker tracker(kSettings, {0.0, 0.0, 3.13}, sure(0.1, 0.1));
  ASSERT_TRUE(tracker.correct(match_at({0.0, 0.0, -3.13}, {100.0, 0.0, 0.0, 100.0, 0.0, 100.0})));
  EXPECT_NEAR(std::abs(tracker.pose().yaw_rad), std::numbers::pi, 1e-9);
}

TEST(PoseTracker, MovesAsTheWheelsSayAndKnowsLess) {
  PoseTracker tracker(kSettings, {1.0, 2.0, 0.5 * std::numbers::pi}, sure(0.0, 0.0));
  tracker.move(point({5.0, 5.0, 0.0}, 10.0), point({6.0, 5.0, 0.0}, 11.0));
  EXPECT_NEAR(tracker.pose().x_m, 1.0, 1e-9);
  EXPECT_NEAR(tracker.pose().y_m, 3.0, 1e-9);
  // Each wheel's way has 1 cm after 1 m: along the half of both, and the turn by their difference.
  EXPECT_NEAR(std::sqrt(tracker.covariance().y_y), 0.01 / std::sqrt(2.0), 1e-9);
  EXPECT_NEAR(std::sqrt(tracker.covariance().yaw_yaw), 0.01 * std::sqrt(2.0), 1e-9);
  EXPECT_GT(tracker.covariance().x_x, 0.0);
}

TEST(PoseTracker, KnowsNoLessWhileItStands) {
  PoseTracker tracker(kSettings, {}, sure(0.01, 0.01));
  tracker.move(point({5.0, 5.0, 1.0}, 10.0), point({5.0, 5.0, 1.0}, 10.0));
  EXPECT_EQ(tracker.covariance().x_x, 1e-4);
  EXPECT_EQ(tracker.covariance().yaw_yaw, 1e-4);
}

TEST(PoseTracker, KnowsLessBeyondTheLastReading) {
  PoseTracker tracker(kSettings, {}, sure(0.0, 0.0));
  tracker.move(point({0.0, 0.0, 0.0}, 0.0), point({0.0, 0.0, 0.0}, 0.0, 0.5));
  EXPECT_NEAR(tracker.position_sigma_m(), 0.125, 1e-9);  // ½ · 1 m/s² · (0.5 s)²
}

}  // namespace
}  // namespace tether
