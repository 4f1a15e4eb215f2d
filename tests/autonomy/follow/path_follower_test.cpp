#include <gtest/gtest.h>

#include <cmath>

#include "common/scenario/scenario.hpp"
#include "onboard/autonomy/onboard_driver.hpp"
#include "onboard/autonomy/swept_way.hpp"

namespace tether {
namespace {

constexpr double kStep_s = 0.02;

Scenario on_a_line() {
  return parse_scenario("[path]\nkind = \"line\"\nlength_m = 20.0\nspeed_mps = 1.0\n", "test");
}

TEST(PathFollower, AVehicleThatDoesWhatItWantsStaysOnThePath) {
  PathFollower follower(on_a_line());
  Pose2 pose;
  for (int i = 0; i < 700; ++i) {
    const Twist u = follower.wanted(pose);
    pose = moved(pose, u, kStep_s);
    follower.advance(kStep_s, u.v_mps);
    ASSERT_LT(std::abs(follower.reference().x_m - pose.x_m), 0.05);
  }
  EXPECT_NEAR(follower.clock_s(), 14.0, 0.3);
}

TEST(PathFollower, ThePathWaitsWhileTheVehicleStands) {
  PathFollower follower(on_a_line());
  for (int i = 0; i < 200; ++i) follower.advance(kStep_s, 1.0);
  const double clock_s = follower.clock_s();
  for (int i = 0; i < 500; ++i) follower.advance(kStep_s, 0.0);
  EXPECT_EQ(follower.clock_s(), clock_s);
}

TEST(PathFollower, ASlowedVehicleIsFollowedAtItsOwnSpeed) {
  PathFollower follower(on_a_line());
  for (int i = 0; i < 250; ++i) follower.advance(kStep_s, 1.0);  // at cruise speed
  const double way_m = follower.way_m();
  for (int i = 0; i < 100; ++i) follower.advance(kStep_s, 0.25);
  EXPECT_NEAR(follower.way_m() - way_m, 0.5, 0.01);
}

TEST(PathFollower, FindsWhereTheVehicleIsBackOnThePath) {
  PathFollower follower(on_a_line());
  for (int i = 0; i < 250; ++i) follower.advance(kStep_s, 1.0);
  EXPECT_FALSE(follower.place_of({9.0, 1.0, 0.0})) << "beside it";
  EXPECT_FALSE(follower.place_of({9.0, 0.1, 1.0})) << "across it";
  EXPECT_FALSE(follower.place_of({1.0, 0.0, 0.0})) << "behind where it was";
  const std::optional<double> place = follower.place_of({9.0, 0.1, 0.1});
  ASSERT_TRUE(place);
  follower.go_to(*place);
  EXPECT_NEAR(follower.reference().x_m, 9.0, 0.06);
  EXPECT_NEAR(follower.way_m(), 9.0, 0.06);
}

TEST(PathFollower, TheWayAheadIsAsLongAsAskedOrEndsWithThePath) {
  PathFollower follower(on_a_line());
  const std::vector<Pose2> way = follower.way(10.0, 3.0);
  EXPECT_NEAR(way.back().x_m - way.front().x_m, 3.0, 0.11);
  EXPECT_NEAR(follower.way(10.0, 300.0).back().x_m, 20.0, 1e-6);
}

}  // namespace
}  // namespace tether
