#include "common/path/waypoints.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <string>

#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

Waypoints read(const std::string& text) {
  std::istringstream in(text);
  return read_waypoints(in, "lap.csv");
}

std::string waypoints_refusal(const std::string& text) {
  return refusal_of([&] { read(text); });
}

TEST(Waypoints, AreReadInOrderWithTheirLines) {
  const Waypoints path = read("# an aisle\nx_m,y_m,v_mps\n0,0,0\n\n5,1,1.5\n9,0,0\n");
  ASSERT_EQ(path.points.size(), 3U);
  EXPECT_EQ(path.points[1].x_m, 5.0);
  EXPECT_EQ(path.points[1].y_m, 1.0);
  EXPECT_EQ(path.points[1].v_mps, 1.5);
  EXPECT_EQ(path.points[1].line, 5);
  EXPECT_FALSE(path.is_closed());
}

TEST(Waypoints, MayComeFromASpreadsheet) {
  const Waypoints path =
      read("\xef\xbb\xbf\"y_m\",\"x_m\",\"note\"\r\n\"1\",\"2\",\"door\"\r\n3,4,\r\n");
  ASSERT_EQ(path.points.size(), 2U);
  EXPECT_EQ(path.points[0].x_m, 2.0);
  EXPECT_EQ(path.points[0].y_m, 1.0);
  EXPECT_FALSE(path.points[0].v_mps);
}

TEST(Waypoints, AreClosedIfTheLastIsTheFirst) {
  EXPECT_TRUE(read("x_m,y_m\n0,0\n5,0\n5,5\n0,0\n").is_closed());
  EXPECT_FALSE(read("x_m,y_m\n0,0\n5,0\n5,5\n0,0.01\n").is_closed());
}

TEST(Waypoints, BadFilesAreRefusedWithLineAndReason) {
  const struct {
    const char* text;
    const char* line;
    const char* reason;
  } cases[] = {
      {"", "lap.csv:1: ", "no header line"},
      {"x,y\n0,0\n1,1\n", "lap.csv:1: ", "must name a column x_m"},
      {"x_m,z_m\n0,0\n1,1\n", "lap.csv:1: ", "must name a column y_m"},
      {"x_m,y_m\n", "lap.csv:1: ", "no waypoints"},
      {"x_m,y_m\n0,0\n", "lap.csv:2: ", "at least 2"},
      {"x_m,y_m\n0,0\n1,0\n0,0\n", "lap.csv:4: ", "at least 4"},
      {"x_m,y_m\n0,0\n1,nan\n", "lap.csv:3: ", "y_m = \"nan\" must be a finite number"},
      {"x_m,y_m\n0,0\n1,inf\n", "lap.csv:3: ", "a finite number"},
      {"x_m,y_m\n0,0\n1,\n", "lap.csv:3: ", "y_m = \"\" must be a finite number"},
      {"x_m,y_m\n0,0\n1\n", "lap.csv:3: ", "1 cells, but the header has 2"},
      {"x_m,y_m\n0,0\n2e5,0\n", "lap.csv:3: ", "within ±100000 m"},
      {"x_m,y_m\n0,0\n5,0\n5,0\n9,0\n", "lap.csv:4: ", "same as that of line 3"},
      {"x_m,y_m,v_mps\n0,0,1\n5,0,-1\n9,0,1\n", "lap.csv:3: ", "v_mps = \"-1\" must be in"},
      {"x_m,y_m,v_mps\n0,0,1\n5,0,0\n9,0,1\n", "lap.csv:3: ", "v_mps = \"0\" must be in"},
      {"x_m,y_m,v_mps\n0,0,1\n5,0,\n9,0,1\n", "lap.csv:3: ", "v_mps = \"\""},
      {"x_m,y_m\n0,0\n5,0\n1,0.5\n", "lap.csv:3: ", "turns back by 173°"},
      {"x_m,y_m\n0,0\n5,1\n9,0\n5,-0.5\n0,0\n", "lap.csv:4: ", "turns back by"},
      {"x_m,y_m\n0,0\n9,1\n12,1\n12,-1\n9,-1\n0,0\n", "lap.csv:2: ", "turns back by"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(waypoints_refusal(c.text), StartsWith(c.line)) << c.text;
    EXPECT_THAT(waypoints_refusal(c.text), HasSubstr(c.reason)) << c.text;
  }
}

TEST(Waypoints, FilesThatAreNoneAreRefused) {
  const auto refusal_of_file = [](const char* file) {
    return refusal_of([&] { load_waypoints(file); });
  };
  EXPECT_THAT(refusal_of_file("/nowhere.csv"),
              HasSubstr("cannot read the waypoints \"/nowhere.csv\""));
  EXPECT_THAT(refusal_of_file("/tmp"), HasSubstr("a directory"));
  EXPECT_THAT(refusal_of_file("/dev/zero"), HasSubstr("not a regular file"));
}

}  // namespace
}  // namespace tether
