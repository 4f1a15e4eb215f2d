#include "common/world/occupancy_map.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "common/base/errors.hpp"
#include "common/base/random.hpp"
#include "common/scenario/scenario.hpp"
#include "common/world/surroundings.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

const std::string kYaml =
    "image: hall.pgm\nresolution: 0.5\norigin: [-1, 2, 0]\nnegate: 0\noccupied_thresh: 0.65\n"
    "free_thresh: 0.25\n";
// Occupied: the upper left cell, and the right one of the lower row; 128 is unknown.
const std::string kImage =
    "P2\n# drawn manually\n3 2 # columns, rows\n255\n0 255 128\n254 255 10\n";

class MapTest : public ::testing::Test {
 protected:
  OccupancyMap load(const std::string& yaml = kYaml, const std::string& image = kImage) {
    folder_.file("hall.pgm", image);
    return load_occupancy_map(folder_.file("hall.yaml", yaml).string());
  }

  std::string refusal(const std::string& yaml, const std::string& image = kImage) {
    return refusal_of([&] { load(yaml, image); });
  }

  /// kYaml with another value of a key; without one: without the key.
  static std::string with(const std::string& key, const std::string& value) {
    std::string text;
    for (std::string line; const char c : kYaml) {
      line += c;
      if (c != '\n') continue;
      if (!line.starts_with(key + ":")) text += line;
      line.clear();
    }
    return value.empty() ? text : text + key + ": " + value + "\n";
  }

  test::Folder folder_;
};

std::vector<bool> cells(const std::string& drawn) {
  std::vector<bool> occupied;
  for (const char c : drawn) occupied.push_back(c == '#');
  return occupied;
}

TEST_F(MapTest, HasTheFirstRowOfTheImageFarthestFromItsOrigin) {
  const OccupancyMap map = load();
  EXPECT_EQ(map.columns, 3u);
  EXPECT_EQ(map.rows, 2u);
  EXPECT_EQ(map.occupied, cells("..#"
                                "#.."));
  const auto shapes = occupied_shapes(map);
  ASSERT_EQ(shapes.size(), 2u);
  EXPECT_DOUBLE_EQ(shapes[0].pose.x_m, 0.25);
  EXPECT_DOUBLE_EQ(shapes[0].pose.y_m, 2.25);
  EXPECT_DOUBLE_EQ(shapes[1].pose.x_m, -0.75);
  EXPECT_DOUBLE_EQ(shapes[1].pose.y_m, 2.75);
  EXPECT_EQ(shapes[0].length_m, 0.5);
}

TEST_F(MapTest, IsTurnedAboutItsOrigin) {
  const auto shapes =
      occupied_shapes(load(with("origin", fmt::format("[-1, 2, {}]", std::numbers::pi / 2.0))));
  EXPECT_NEAR(shapes[0].pose.x_m, -1.25, 1e-12);
  EXPECT_NEAR(shapes[0].pose.y_m, 3.25, 1e-12);
  EXPECT_NEAR(shapes[0].pose.yaw_rad, std::numbers::pi / 2.0, 1e-12);
}

TEST_F(MapTest, NegatedHasWhiteOccupied) {
  EXPECT_EQ(load(with("negate", "1")).occupied, cells("##."
                                                      ".#."));
  EXPECT_EQ(load(with("negate", "true")).occupied, load(with("negate", "1")).occupied);
}

TEST_F(MapTest, TakesAllFormsOfPgm) {
  const std::string eight =
      std::string("P5\n3 2\n255\n") + std::string("\x00\xff\x80\xfe\xff\x0a", 6);
  const std::string sixteen = std::string("P5 3 # wide\n2\n1000\n") +
                              std::string("\x00\x00\x03\xe8\x01\xf4\x03\xe8\x03\xe8\x00\x28", 12);
  const std::string one_byte_lf =
      std::string("P5\n#\n3 2 255 ") + std::string("\n\xff\x80\xfe\xff\x0a", 6);
  for (const std::string& image : {eight, sixteen, one_byte_lf}) {
    EXPECT_EQ(load(kYaml, image).occupied, cells("..#"
                                                 "#.."));
  }
}

TEST_F(MapTest, TakesWhatOtherKeysThereAreAndAnotherFolder) {
  EXPECT_EQ(refusal(kYaml + "mode: trinary\nname: hall 3\n"), "accepted");
  std::filesystem::create_directory(folder_.path / "images");
  folder_.file("images/other.pgm", "P2 1 1 1 0");
  EXPECT_EQ(load(with("image", "images/other.pgm")).columns, 1u);
}

TEST_F(MapTest, NamesFileLineKeyAndWhatIsAllowed) {
  const struct {
    std::string yaml;
    const char* what;
  } cases[] = {
      {with("image", ""), "hall.yaml: image is missing: must be the name of a PGM file"},
      {with("image", "[]"), "image = [] is not allowed: must be the name of a PGM file"},
      {with("resolution", "0"),
       "hall.yaml:6: resolution = 0 is not allowed: must be a number in [0.001, 100]"},
      {with("resolution", "-0.05"), "resolution = -0.05 is not allowed"},
      {with("resolution", ".nan"), "resolution = .nan is not allowed"},
      {with("resolution", "fine"),
       "resolution = fine is not allowed: must be a number in [0.001, 100]"},
      {with("resolution", ""), "resolution is missing: must be a number in [0.001, 100]"},
      {with("origin", "[1, 2]"), "origin = [1, 2] is not allowed: must be [x, y, yaw]"},
      {with("origin", "[1, .inf, 0]"), "is not allowed: must be [x, y, yaw]"},
      {with("negate", "2"), "negate = 2 is not allowed: must be 0 or 1"},
      {with("occupied_thresh", "65"),
       "occupied_thresh = 65 is not allowed: must be a number in [0, 1]"},
      {with("free_thresh", ""), "free_thresh is missing"},
      {with("free_thresh", "0.9"),
       "free_thresh = 0.9 is not allowed: must be below occupied_thresh"},
      {with("mode", "trinary") + "resolution: 0.1\n", "resolution is there twice"},
      {with("mode", "trinary") + "mode: trinary\n", "mode is there twice"},
      {with("mode", "scale"), "mode = scale is not allowed: must be trinary, or not be there"},
      {"[1, 2]", "must be a YAML file with image, resolution, origin"},
      {"", "must be a YAML file with image"},
      {"image: [", "hall.yaml:"},
      {with("image", "none.pgm"), "cannot read the image of /"},
      {with("image", "none.pgm"), "none.pgm\": No such file or directory"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(refusal(c.yaml),
                AllOf(HasSubstr(c.what), HasSubstr("hall.yaml"), Not(HasSubstr("\n"))))
        << c.yaml;
  }
}

TEST_F(MapTest, SaysWhatIsWrongWithItsImage) {
  const struct {
    std::string image;
    const char* what;
  } cases[] = {
      {"", "begins with \"\": must be a PGM image, P2 or P5"},
      {"P6 1 1 255 abc", "begins with \"P6\": must be a PGM image, P2 or P5"},
      {"\x89PNG", "must be a PGM image"},
      {"P5 3", "the height = \"\" must be a whole number in [1, 50000]"},
      {"P5 0 2 255 ", "the width = \"0\" must be a whole number in [1, 50000]"},
      {"P5 -3 2 255 ", "the width = \"-3\" must be"},
      {"P5 3 2 70000 ", "the largest value = \"70000\" must be a whole number in [1, 65535]"},
      {"P5 3 2 255", "has no pixels behind its largest value"},
      {"P5 3 2 255 abcde", "is cut off: it has fewer than the 6 pixels that it announces"},
      {"P5 3 2 256 abcdefghijk", "is cut off"},
      {"P5 50000 50000 255 a", "is cut off: it has fewer than the 2500000000 pixels"},
      {"P5 1 1 100 z", "a pixel has 122, but the header's maximum is 100"},
      {"P2 3 2 255 1 2 3 4 5", "is cut off"},
      {"P2 3 2 255 1 2 3 4 5 256", "a pixel = \"256\" must be a whole number in [0, 255]"},
      {"P2 3 2 255 1 2 3 4 5 6 7", "is larger than the 3 x 2 pixels that it announces"},
      {"P5 3 2 255 abcdefg", "is larger than the 3 x 2 pixels that it announces"},
      {"P2 3 2 255 1 2 3 4 5 x", "a pixel = \"x\" must be a whole number in [0, 255]"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(refusal(kYaml, c.image), AllOf(HasSubstr("hall.pgm: the map's image "),
                                               HasSubstr(c.what), Not(HasSubstr("\n"))))
        << c.image;
  }
}

TEST(OccupiedShapes, CoverTheOccupiedCellsOnceAndNothingElse) {
  RandomEngine random = random_stream(1, "map");
  for (const double share : {0.1, 0.5, 0.9, 1.0}) {
    OccupancyMap map{.columns = 23, .rows = 17, .resolution_m = 0.1, .origin = {1.0, -2.0, 0.0}};
    for (std::size_t i = 0; i < 23u * 17u; ++i) {
      map.occupied.push_back(uniform_01(random) < share);
    }
    const auto shapes = occupied_shapes(map);
    for (std::size_t row = 0; row < map.rows; ++row) {
      for (std::size_t column = 0; column < map.columns; ++column) {
        const Position centre{1.0 + 0.1 * (static_cast<double>(column) + 0.5),
                              -2.0 + 0.1 * (static_cast<double>(row) + 0.5)};
        const auto covers = [&](const Shape& s) { return distance_m(s, centre) < 0.0; };
        EXPECT_EQ(std::ranges::count_if(shapes, covers), map.at(column, row) ? 1 : 0);
      }
    }
    if (share == 1.0) {
      EXPECT_EQ(shapes.size(), 1u);
    }
  }
}

TEST_F(MapTest, StandsInTheHallAndIsWhatLocalisersKnow) {
  folder_.file("hall.pgm", kImage);
  folder_.file("hall.yaml", with("origin", "[10, 2, 0]"));
  const auto file = folder_.file("a.toml", "[map]\nfile = \"hall.yaml\"\n");
  const Scenario s = load_scenario(file.string(), {});
  EXPECT_EQ(standing_shapes(s).size(), 4u + 2u);
  EXPECT_EQ(mapped_shapes(s).size(), 4u + 2u);
  EXPECT_EQ(solid_shapes(s.get<Surroundings>()).size(), 2u);
  EXPECT_THAT(to_toml(s), HasSubstr("hall.yaml"));
}

TEST_F(MapTest, IsRefusedWhereItIsBeyondTheHallOrAtTheStart) {
  const auto refused = [&](const std::string& origin) -> std::string {
    folder_.file("hall.pgm", kImage);
    folder_.file("hall.yaml", with("origin", origin));
    return refusal_of([&] {
      load_scenario(folder_.file("a.toml", "[map]\nfile = \"hall.yaml\"\n").string(), {});
    });
  };
  EXPECT_THAT(refused("[21, 2, 0]"),
              AllOf(HasSubstr("what map.file = \""),
                    HasSubstr("hall.yaml\" shows at (22.25, 2.25) m is in or "
                              "beyond a wall")));
  EXPECT_THAT(refused("[0, 0, 0]"), HasSubstr("in an obstacle: what map.file = \""));
  EXPECT_EQ(refused("[5, 5, 0]"), "accepted");
}

// kImage is 3 x 2 cells, with its upper left and its lower right one occupied.
TEST_F(MapTest, BeyondTheHallMayBeOfAWrongResolutionWhichIsSaidWithTheOneThatFits) {
  folder_.file("hall.pgm", kImage);
  const auto refused = [&](const std::string& resolution, const std::string& origin) {
    folder_.file("hall.yaml",
                 "image: hall.pgm\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25"
                 "\nresolution: " +
                     resolution + "\norigin: " + origin + "\n");
    return refusal_of([&] {
      load_scenario(folder_.file("a.toml", "[map]\nfile = \"hall.yaml\"\n").string(), {});
    });
  };
  // Three cells to the right of x = 7 are within 22 m if each is no more than 5 m.
  EXPECT_THAT(
      refused("8", "[7, 3, 0]"),
      AllOf(HasSubstr("it reaches 31.00 m and must be within ±22 m (world.half_extent_m), or "
                      "in "),
            HasSubstr("hall.yaml resolution = 8 is wrong: at most 5 fits"), Not(HasSubstr("\n"))));
  EXPECT_EQ(refused("5", "[7, 3, 0]"), "accepted");
  // Turned to the left three cells reach up, two to the left.
  EXPECT_THAT(refused("12", "[-4, -14, 1.5707963267948966]"),
              HasSubstr("resolution = 12 is wrong: at most 9 fits"));
  EXPECT_THAT(refused("0.5", "[23, 2, 0]"),
              HasSubstr("hall.yaml origin = [23, 2, …] is wrong: with it no resolution fits"));
}

TEST_F(MapTest, OfAScenarioIsRefusedWithItsFileAndKey) {
  const auto refused = [&](const std::string& yaml, const std::string& image) -> std::string {
    folder_.file("hall.pgm", image);
    if (!yaml.empty()) folder_.file("hall.yaml", yaml);
    return refusal_of([&] {
      load_scenario(folder_.file("a.toml", "[map]\nfile = \"hall.yaml\"\n").string(), {});
    });
  };
  EXPECT_THAT(refused("", kImage),
              AllOf(HasSubstr("a.toml: map.file: cannot read the map "),
                    HasSubstr("hall.yaml\": No such file"), Not(HasSubstr("\n"))));
  const std::string yaml = with("origin", "[5, 5, 0]");
  EXPECT_EQ(refused(yaml, kImage), "accepted");
  EXPECT_THAT(refused(yaml, "P6"), AllOf(HasSubstr("a.toml: map.file: "),
                                         HasSubstr("hall.pgm: the map's image begins with")));
  EXPECT_THAT(refused(yaml, "P2 3 2 255 1"), AllOf(HasSubstr("a.toml: map.file: "),
                                                   HasSubstr("hall.pgm: the map's image is cut")));
  EXPECT_THAT(refused(with("resolution", "0"), kImage),
              AllOf(HasSubstr("a.toml: map.file: "),
                    HasSubstr("hall.yaml:6: resolution = 0 is not allowed: must be a number in")));
}

TEST(ExampleMap, IsARoomWithADoorTwoTablesAndACrate) {
  const OccupancyMap map = load_occupancy_map(in_source("/scenarios/maps/room.yaml"));
  EXPECT_EQ(map.columns * map.rows, 40u * 30u);
  const auto shapes = occupied_shapes(map);
  EXPECT_EQ(shapes.size(), 8u) << "three walls, two beside the door, and what stands in it";
  const auto occupied = [&](double x_m, double y_m) {
    return std::ranges::any_of(shapes, [&](const Shape& s) {
      return distance_m(s, {x_m, y_m}) < 0.0;
    });
  };
  EXPECT_TRUE(occupied(-3.9, 0.0)) << "a wall";
  EXPECT_FALSE(occupied(3.9, 0.0)) << "the door";
  EXPECT_TRUE(occupied(-2.0, 1.4)) << "a table";
  EXPECT_TRUE(occupied(1.5, -1.9)) << "the crate";
  EXPECT_FALSE(occupied(0.0, 2.0)) << "unknown is not occupied";
}

}  // namespace
}  // namespace tether
