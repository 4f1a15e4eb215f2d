#include "onboard/localiser/pose_search.hpp"

#include <gtest/gtest.h>

#include "tests/localiser/hall.hpp"

namespace tether {
namespace {

using test::hall;
using test::HallScanner;
using test::walls;

PoseSearch search_in(const std::vector<Shape>& map) {
  return {std::make_shared<const DistanceField>(map, 0.05), PoseSearch::Settings{},
          random_stream(1, "search")};
}

/// Scans until it is found; 0 if it is not within this many.
int scans_until_found(PoseSearch& search, const std::vector<Shape>& world, const Pose2& truth,
                      int most, Pose2* found = nullptr) {
  RandomEngine random = random_stream(1, "scanner");
  for (int i = 1; i <= most; ++i) {
    const auto match = search.look(
        beams_of(HallScanner().measure_standing(world, truth, random), {}, kStart, 1000));
    if (!match) continue;
    if (found != nullptr) *found = match->pose;
    return i;
  }
  return 0;
}

TEST(PoseSearch, FindsTheOnePlaceThatFitsAfterAllWereLookedAt) {
  PoseSearch search = search_in(hall());
  const Pose2 truth{-12.0, -8.0, 2.0};
  Pose2 found;
  const int scans = scans_until_found(search, hall(), truth, 75, &found);
  EXPECT_GE(scans, search.sweep_scans());
  EXPECT_NEAR(found.x_m, truth.x_m, 0.01);
  EXPECT_NEAR(found.y_m, truth.y_m, 0.01);
  EXPECT_NEAR(found.yaw_rad, truth.yaw_rad, 0.002);
}

TEST(PoseSearch, DoesNotDecideInAHallThatLooksTheSameFromTwoPlaces) {
  PoseSearch search = search_in(walls(24.0, 14.0));
  EXPECT_EQ(scans_until_found(search, walls(24.0, 14.0), {5.0, 3.0, 0.5}, 60), 0);
}

TEST(PoseSearch, DoesNotDecideInACorridorWithoutEnds) {
  const std::vector<Shape> map{test::box(0.0, 2.25, 150.0, 0.5), test::box(0.0, -2.25, 150.0, 0.5)};
  PoseSearch search = search_in(map);
  EXPECT_EQ(scans_until_found(search, map, {0.0, 0.0, 0.2}, 40), 0);
}

TEST(PoseSearch, FindsAVehicleThatMovesMeanwhile) {
  PoseSearch search = search_in(hall());
  RandomEngine random = random_stream(1, "scanner");
  Pose2 truth{-13.0, 4.5, 0.0};
  for (int i = 0; i < 75; ++i) {
    const Pose2 step{0.07, 0.0, 0.005};  // 1 m/s
    truth = compose(truth, step);
    search.move(step);
    const auto match = search.look(
        beams_of(HallScanner().measure_standing(hall(), truth, random), {}, kStart, 1000));
    if (!match) continue;
    EXPECT_NEAR(match->pose.x_m, truth.x_m, 0.02);
    EXPECT_NEAR(match->pose.y_m, truth.y_m, 0.02);
    return;
  }
  FAIL() << "not found";
}

TEST(PoseSearch, LooksOnlyWhereTheVehicleCanGetTo) {
  // A wall halves the hall.
  std::vector<Shape> map = hall();
  map.push_back(test::box(0.5, 0.0, 0.2, 20.0));
  const auto sweep_from = [&](double x_m) {
    PoseSearch::Settings settings;
    settings.inside = {x_m, 4.0};
    return PoseSearch(std::make_shared<const DistanceField>(map, 0.05), settings,
                      random_stream(1, "search"))
        .sweep_scans();
  };
  const int all = search_in(hall()).sweep_scans();
  EXPECT_LT(sweep_from(-13.0), all);
  EXPECT_LT(sweep_from(13.0), all);
  EXPECT_NEAR(sweep_from(-13.0) + sweep_from(13.0), all, 2.0);
}

TEST(PoseSearch, WithFewBeamsKnowsNothing) {
  PoseSearch search = search_in(hall());
  EXPECT_FALSE(search.look(std::vector<Beam>(5)).has_value());
  EXPECT_FALSE(search.best().has_value());
}

TEST(PoseSearch, IsTheSameWithTheSameSeed) {
  PoseSearch a = search_in(hall()), b = search_in(hall());
  RandomEngine random = random_stream(1, "scanner");
  for (int i = 0; i < 3; ++i) {
    const auto beams = beams_of(HallScanner().measure_standing(hall(), {3.0, -7.0, 1.0}, random),
                                {}, kStart, 1000);
    a.look(beams);
    b.look(beams);
    ASSERT_TRUE(a.best().has_value());
    EXPECT_EQ(a.best()->x_m, b.best()->x_m);
    EXPECT_EQ(a.best()->yaw_rad, b.best()->yaw_rad);
  }
}

}  // namespace
}  // namespace tether
