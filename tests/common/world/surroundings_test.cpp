#include "common/world/surroundings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

Scenario parse(const std::string& toml, const std::vector<std::string>& overrides = {}) {
  return parse_scenario(toml, "a.toml", overrides);
}

std::string refusal(const std::string& toml, const std::vector<std::string>& overrides = {}) {
  return refusal_of([&] { parse(toml, overrides); });
}

std::string obstacle(const std::string& keys) { return "[[world.obstacle]]\n" + keys + "\n"; }

const std::vector<Obstacle>& obstacles_of(const Scenario& scenario) {
  return scenario.get<Surroundings>().obstacles;
}

TEST(Surroundings, AreEmptyAndNotInTheResolvedScenarioByDefault) {
  EXPECT_TRUE(obstacles_of(Scenario{}).empty());
  EXPECT_THAT(to_toml(Scenario{}), Not(HasSubstr("obstacle")));
  EXPECT_THAT(to_toml(Scenario{}), Not(HasSubstr("[map]")));
  EXPECT_EQ(standing_shapes(Scenario{}).size(), 4u) << "the walls";
}

TEST(Surroundings, HaveObstaclesWithTheirKindsDefaults) {
  const Scenario s =
      parse(obstacle("x_m = 5\ny_m = -4") +
            obstacle("kind = \"rack\"\nx_m = 9\ny_m = 9\nyaw_deg = 90\nlength_m = 4") +
            obstacle("kind = \"cylinder\"\nx_m = 1\ny_m = 9\nto = [[2, 9], [2, 12]]"));
  ASSERT_EQ(obstacles_of(s).size(), 3u);
  const Obstacle &box = obstacles_of(s)[0], &rack = obstacles_of(s)[1],
                 &person = obstacles_of(s)[2];
  EXPECT_EQ(box.kind, Obstacle::Kind::box);
  EXPECT_EQ(box.pose.y_m, -4.0);
  EXPECT_EQ(box.length_m, 1.0);
  EXPECT_TRUE(box.mapped);
  EXPECT_NEAR(rack.pose.yaw_rad, std::numbers::pi / 2.0, 1e-12);
  EXPECT_EQ(rack.length_m, 4.0);
  EXPECT_EQ(rack.width_m, 1.1);
  EXPECT_TRUE(person.moves());
  EXPECT_FALSE(person.mapped);
  EXPECT_EQ(person.to[1].y_m, 12.0);
}

TEST(Surroundings, ResolveToTheSameAgain) {
  const Scenario s =
      parse(obstacle("x_m = 5\ny_m = -4\nyaw_deg = 33\nmapped = false\nreflectivity = 0.1") +
            obstacle("kind = \"cylinder\"\nx_m = 1\ny_m = 9\nto = [[2, 9]]\npause_s = 0") +
            obstacle("kind = \"wall\"\nx_m = 0\ny_m = 15\nlength_m = 8"));
  const std::string text = to_toml(s);
  EXPECT_EQ(to_toml(parse(text)), text);
  EXPECT_THAT(text, AllOf(HasSubstr("to = [[2.0, 9.0]]"), HasSubstr("mapped = false"),
                          HasSubstr("kind = \"wall\"")));
}

TEST(Surroundings, CanBeGivenAtTheCommandLine) {
  const Scenario s =
      parse("", {"world.obstacle=[{kind = \"cylinder\", x_m = 5, y_m = 1, radius_m = 0.3}]"});
  ASSERT_EQ(obstacles_of(s).size(), 1u);
  EXPECT_EQ(obstacles_of(s)[0].radius_m, 0.3);
}

TEST(Surroundings, RefuseWhatIsWrongByNumberKeyAndWhatIsAllowed) {
  const std::string at = "x_m = 9\ny_m = 9\n";
  const struct {
    std::string keys;
    const char* what;
  } cases[] = {
      {"y_m = 9", "x_m is missing: must be a number in [-10000, 10000]"},
      {at + "kind = \"tree\"",
       "kind = \"tree\" is not allowed: must be one of \"box\", \"cylinder\", \"wall\", \"rack\""},
      {at + "radius_m = 1", "unknown key \"radius_m\": a box has kind, mapped, yaw_deg, to, x_m"},
      {at + "kind = \"cylinder\"\nradius_m = 0",
       "radius_m = 0 is not allowed: must be a number in [0.01, 10000]"},
      {at + "width_m = 0.0", "width_m = 0.0 is not allowed: must be a number in [0.01"},
      {at + "length_m = \"long\"", "length_m = \"long\" is not allowed: must be a number"},
      {at + "reflectivity = 1.5", "reflectivity = 1.5 is not allowed: must be a number in [0, 1]"},
      {at + "mapped = 1", "mapped = 1 is not allowed: must be true or false"},
      {at + "yaw_deg = 10\nyaw_rad = 1", "yaw_deg and yaw_rad are both given"},
      {at + "yaw_deg = 400", "yaw_deg = 400 is not allowed: must be a number in [-360, 360]"},
      {at + "speed_mps = 1", "speed_mps has no effect: it stands; to = [[x, y], ...]"},
      {at + "pause_s = 1", "pause_s has no effect"},
      {at + "to = []", "to = [] is not allowed: must be a list of one place [x, y] or more"},
      {at + "to = [[1, 2, 3]]", "to = [[1.0, 2.0, 3.0]] is not allowed"},
      {at + "to = [[9, 9]]", "each at least 0.01 m from the one before"},
      {at + "to = [[8, 9], [9, 9]]", "each at least 0.01 m from the one before"},
      {at + "to = [[8, 9]]\nspeed_mps = 0",
       "speed_mps = 0 is not allowed: must be a number in [0."},
      {at + "to = [[8, 9]]\nmapped = true", "what moves is in no map"},
      {at + "kind = \"rack\"\nto = [[8, 9]]", "unknown key \"to\": a rack has"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(refusal(obstacle("x_m = 5\ny_m = 5") + obstacle(c.keys)),
                AllOf(StartsWith("a.toml:"), HasSubstr(": [[world.obstacle]] 2: "),
                      HasSubstr(c.what), Not(HasSubstr("\n"))));
  }
  EXPECT_THAT(refusal("[world]\nobstacle = 3"),
              HasSubstr("world.obstacle must be a list of tables"));
}

TEST(Surroundings, StandWithinTheHall) {
  EXPECT_EQ(refusal(obstacle("x_m = 21.5\ny_m = 0")), "accepted");
  EXPECT_THAT(refusal(obstacle("x_m = 21.6\ny_m = 10")),
              HasSubstr("[[world.obstacle]] 1 at (21.6, 10) m is in or beyond a wall: it reaches "
                        "22.10 m and must be within ±22 m (world.half_extent_m)"));
  EXPECT_THAT(refusal(obstacle("kind = \"cylinder\"\nx_m = 9\ny_m = 9\nto = [[30, 9]]")),
              HasSubstr("at (30, 9) m is in or beyond a wall"));
}

TEST(Surroundings, AreNotWhereTheVehicleStarts) {
  // The paper's vehicle reaches from 0.5 m behind its axle to 1.5 m ahead of it.
  EXPECT_EQ(refusal(obstacle("x_m = 2.1\ny_m = 0")), "accepted");
  EXPECT_THAT(refusal(obstacle("x_m = 1.9\ny_m = 0")),
              HasSubstr("the vehicle starts at (0, 0) m, in an obstacle: [[world.obstacle]] 1 at "
                        "(1.9, 0) m; there must be more than 0.00 m between them"));
  EXPECT_THAT(
      refusal(obstacle("x_m = 2.1\ny_m = 0"), {"vehicle.start_error_m=0.1"}),
      HasSubstr("0.10 m from an obstacle: [[world.obstacle]] 1 at (2.1, 0) m; there must be "
                "more than 0.42 m between them"));
  EXPECT_THAT(refusal(obstacle("x_m = 0\ny_m = 0\nto = [[5, 5]]")), HasSubstr("in an obstacle"))
      << "moving ones begin somewhere, too";
}

TEST(Surroundings, AreNotInThePathsWayUnlessNoMapShowsThem) {
  const std::vector<std::string> line{"path.kind=line", "path.length_m=15"};
  const std::string at = "x_m = 10\ny_m = 0.9\n";
  EXPECT_THAT(refusal(obstacle(at), line),
              AllOf(StartsWith("a.toml: 8.0"), HasSubstr("m along the path, at (8.0"),
                    HasSubstr("the vehicle would be in [[world.obstacle]] 1 at (10, 0.9) m")));
  EXPECT_EQ(refusal(obstacle(at + "mapped = false"), line), "accepted");
  EXPECT_EQ(refusal(obstacle(at + "to = [[10, 5]]"), line), "accepted");
  EXPECT_EQ(refusal(obstacle("x_m = 10\ny_m = 1.3\n"), line), "accepted");
}

TEST(Shapes, OfTheWallsStandOutsideThem) {
  for (const Shape& wall : standing_shapes(Scenario{})) {
    EXPECT_NEAR(distance_m(wall, {0.0, 0.0}), 22.0, 1e-12);
  }
}

TEST(Shapes, OfARackAreAShelfAndPostsAtItsCornersAndBetween) {
  const Scenario s = parse(
      obstacle("kind = \"rack\"\nx_m = 5\ny_m = 9\nyaw_deg = 90\nlength_m = 5.7\nwidth_m = 1"));
  const auto shapes = standing_shapes(s);
  ASSERT_EQ(shapes.size(), 4u + 1u + 6u);
  const Shape& shelf = shapes[4];
  EXPECT_EQ(shelf.length_m, 5.7);
  EXPECT_EQ(shelf.clearance_m, kShelfClearance_m);
  for (std::size_t i = 5; i < shapes.size(); ++i) {
    EXPECT_EQ(shapes[i].clearance_m, 0.0);
    for (const Position& corner : corners(shapes[i])) {
      EXPECT_LE(distance_m(shelf, corner), 1e-12) << "posts are within the rack's outline";
    }
  }
  EXPECT_NEAR(shapes[5].pose.y_m, 9.0 - 2.8, 1e-12);
  EXPECT_NEAR(shapes[7].pose.y_m, 9.0, 1e-12);
  const auto solid = solid_shapes(s.get<Surroundings>());
  ASSERT_EQ(solid.size(), 1u) << "the whole box";
  EXPECT_EQ(solid[0].length_m, 5.7);
}

TEST(Shapes, OfTheMapAreWhatIsMappedAndStands) {
  const Scenario s =
      parse(obstacle("x_m = 5\ny_m = 5") + obstacle("x_m = 8\ny_m = 8\nmapped = false") +
            obstacle("x_m = 5\ny_m = 15\nto = [[6, 15]]"));
  EXPECT_EQ(standing_shapes(s).size(), 4u + 2u);
  EXPECT_EQ(mapped_shapes(s).size(), 4u + 1u);
}

}  // namespace
}  // namespace tether
