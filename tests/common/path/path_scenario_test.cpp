#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

Scenario parse_path(const std::vector<std::string>& overrides, const std::string& toml = "") {
  return parse_scenario(toml, "a.toml", overrides);
}

std::string path_refusal(const std::vector<std::string>& overrides, const std::string& toml = "") {
  return refusal_of([&] { parse_path(overrides, toml); });
}

const char* const kKinds[] = {"circle", "line", "rounded_rectangle"};

TEST(PathKeys, EachKindIsFeasibleByDefault) {
  for (const std::string kind : kKinds) {
    EXPECT_EQ(path_refusal({"path.kind=" + kind}), "accepted");
    EXPECT_EQ(
        path_refusal({"path.kind=" + kind, "vehicle.drivetrain=can", "can.drivetrain=x.toml"}),
        "accepted");
  }
}

TEST(PathKeys, AKeyOfAnotherKindIsRefused) {
  EXPECT_THAT(path_refusal({"path.kind=circle", "path.length_m=3"}),
              HasSubstr("path.length_m has no effect: path.kind is \"circle\""));
  EXPECT_THAT(path_refusal({"path.radius_m=3"}),
              HasSubstr("path.radius_m has no effect: path.kind is \"figure_eight\""));
  EXPECT_THAT(path_refusal({"path.kind=line", "path.csv=a.csv"}),
              HasSubstr("path.csv has no effect"));
  // Keys in the file for its own path may stay.
  EXPECT_EQ(path_refusal({"path.kind=circle"}, "[path]\namplitude_m = 10.0"), "accepted");
}

TEST(PathKeys, TheResolvedTextNamesThoseWithAnEffect) {
  const Scenario circle =
      parse_path({"path.kind=circle", "path.radius_m=3", "path.clockwise=true"});
  const std::string text = to_toml(circle);
  EXPECT_THAT(text, HasSubstr("kind = \"circle\"\nradius_m = 3.0\nclockwise = true\n"));
  EXPECT_THAT(text, Not(HasSubstr("amplitude_m")));
  EXPECT_THAT(text, Not(HasSubstr("corner_radius_m")));
  EXPECT_EQ(to_toml(parse_path({}, text)), text);
  EXPECT_THAT(to_toml(Scenario{}), Not(HasSubstr("max_lateral_acceleration_mps2")));
}

TEST(PathStart, TheVehicleStartsWhereItsPathDoes) {
  const Scenario s = parse_path(
      {"path.kind=line", "path.start_x_m=-5", "path.start_y_m=4", "path.start_yaw_rad=-0.5"});
  EXPECT_NEAR(s.get<VehicleSettings>().start_x_m, -5.0, 1e-12);
  EXPECT_NEAR(s.get<VehicleSettings>().start_y_m, 4.0, 1e-12);
  EXPECT_NEAR(s.get<VehicleSettings>().start_yaw_rad, -0.5, 1e-12);
  EXPECT_THAT(to_toml(s), HasSubstr("start_x_m = -5.0"));
}

TEST(PathStart, AGivenStartOfTheVehicleStays) {
  const Scenario s = parse_path({"path.kind=line", "path.start_x_m=-5", "path.start_y_m=4"},
                                "[vehicle]\nstart_y_m = 3.0");
  EXPECT_EQ(s.get<VehicleSettings>().start_x_m, -5.0);
  EXPECT_EQ(s.get<VehicleSettings>().start_y_m, 3.0);
}

TEST(PathStart, TheFigureEightLeavesTheVehicleAtTheOrigin) {
  const Scenario s = parse_path({"path.rotation_rad=1"});
  EXPECT_EQ(s.get<VehicleSettings>().start_yaw_rad, 0.0);
}

TEST(PathCheck, NamesTheLimitItsValueAndThePlace) {
  const struct {
    std::vector<std::string> settings;
    const char* reason;
  } cases[] = {
      {{"path.kind=line", "controller.v.limit=1"}, "a speed of 1.0"},
      {{"path.kind=circle", "path.radius_m=2", "path.max_lateral_acceleration_mps2=5",
        "controller.omega.limit=0.5"},
       "controller.omega.limit = 0.5"},
      {{"path.kind=circle", "path.radius_m=5", "path.speed_mps=3",
        "path.max_lateral_acceleration_mps2=2", "vehicle.max_wheel_speed_mps=3.1"},
       "vehicle.max_wheel_speed_mps = 3.1"},
      {{"path.kind=line", "path.max_acceleration_mps2=4"},
       "vehicle.max_wheel_acceleration_mps2 = 3"},
      {{"path.kind=circle", "path.radius_m=3", "path.speed_mps=2",
        "path.max_lateral_acceleration_mps2=2", "world.friction=0.1"},
       "at the drive wheels, which carry 79 % of the weight; world.friction = 0.1"},
      {{"path.kind=line", "path.speed_mps=2", "vehicle.drivetrain=can", "can.drivetrain=x.toml",
        "can.max_speed_mps=1.8"},
       "can.max_speed_mps = 1.8"},
      {{"path.kind=line", "path.max_deceleration_mps2=2", "vehicle.drivetrain=can",
        "can.drivetrain=x.toml"},
       "can.max_deceleration_mps2 = 1.5"},
      {{"path.kind=line", "path.length_m=30"}, "world.half_extent_m = 22"},
      {{"path.kind=circle", "path.radius_m=12"}, "the vehicle would be in or beyond a wall"},
      {{"path.kind=rounded_rectangle", "path.corner_radius_m=4"},
       "path.corner_radius_m = 4 does not fit"},
      {{"path.kind=circle", "path.radius_m=0.1", "path.max_yaw_rate_radps=0.1"},
       "path.max_yaw_rate_radps and path.max_lateral_acceleration_mps2 leave less than 0.05 m/s"},
      {{"path.kind=csv"}, "needs path.csv"},
      {{"path.kind=csv", "path.csv=/nowhere.csv"}, "cannot read the waypoints \"/nowhere.csv\""},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(path_refusal(c.settings), AllOf(StartsWith("a.toml: "), HasSubstr(c.reason)));
  }
  EXPECT_THAT(path_refusal({"path.kind=line", "path.length_m=30"}),
              HasSubstr("a.toml: 20.55 m along the path, at (20.55, 0.00) m"));
}

TEST(PathCheck, TyresHoldTheirShareOfTheWeightOnly) {
  // 79 % of the weight at friction 0.6: 4.66 m/s².
  const auto at = [](double lateral_mps2, std::vector<std::string> more = {}) {
    const double radius_m = 6.0;
    more.insert(more.end(),
                {"path.kind=circle", fmt::format("path.radius_m={}", radius_m),
                 fmt::format("path.speed_mps={}", std::sqrt(lateral_mps2 * radius_m)),
                 "path.max_lateral_acceleration_mps2=50", "path.max_yaw_rate_radps=50"});
    return path_refusal(more);
  };
  EXPECT_EQ(at(4.65), "accepted");
  EXPECT_THAT(at(4.68), AllOf(HasSubstr("the path needs a friction coefficient of 0.60"),
                              HasSubstr("at the drive wheels, which carry 79 % of the weight; "
                                        "world.friction = 0.6")));
  EXPECT_EQ(at(5.5, {"world.friction=0.8"}), "accepted");
  // A load over the axle presses the tyres; over the caster, it does not.
  EXPECT_EQ(at(5.2, {"vehicle.payload_kg=5", "vehicle.payload_x_m=-0.5"}), "accepted");
  EXPECT_THAT(at(3.5, {"vehicle.payload_kg=5", "vehicle.payload_x_m=0.7",
                       "vehicle.max_wheel_torque_Nm=40"}),
              HasSubstr("which carry 37 % of the weight; world.friction = 0.6"));
  // Circles of friction hold less than ODE's pyramid.
  EXPECT_EQ(at(4.0, {"vehicle.tyre=brush"}), "accepted");
  EXPECT_THAT(at(4.2, {"vehicle.tyre=brush"}), HasSubstr("world.friction = 0.6"));
  EXPECT_EQ(at(5.5, {"vehicle.plant=kinematic"}), "accepted");
}

TEST(PathCheck, TheMotorsMustMoveTheLoadedVehicle) {
  // (2 * 4 N*m / 0.4 m)/(m + 1 kg): 4.5 m/s^2 empty, 2.56 with as much again.
  const auto at = [](double acceleration_mps2, const std::string& payload_kg) {
    return path_refusal({"path.kind=line",
                         fmt::format("path.max_acceleration_mps2={}", acceleration_mps2),
                         "path.max_deceleration_mps2=1", "vehicle.payload_kg=" + payload_kg});
  };
  EXPECT_EQ(at(2.9, "0"), "accepted");
  EXPECT_EQ(at(2.5, "3.41275"), "accepted");
  EXPECT_THAT(at(2.6, "3.41275"), HasSubstr("the path needs a motor's torque of 4.0"));
  EXPECT_THAT(at(2.6, "3.41275"),
              HasSubstr("N*m; with vehicle.payload_kg, vehicle.max_wheel_torque_Nm = 4"));
}

TEST(PathCheck, TheFigureEightIsFreeAsThePaperHasIt) {
  EXPECT_EQ(path_refusal({"path.rate_radps=10", "path.amplitude_m=100"}), "accepted");
}

/// A folder with a scenario and waypoints.
class PathFileTest : public ::testing::Test {
 protected:
  Scenario load(const std::string& csv, const std::vector<std::string>& overrides = {}) {
    folder_.file("lap.csv", csv);
    const auto scenario = folder_.file("a.toml", "[path]\nkind = \"csv\"\ncsv = \"lap.csv\"\n");
    return load_scenario(scenario.string(), overrides);
  }
  std::string path_refusal(const std::string& csv, const std::vector<std::string>& overrides = {}) {
    try {
      load(csv, overrides);
    } catch (const UsageError& error) {
      const std::string text = error.what();
      const std::string name = (folder_.path / "lap.csv").string();
      return text.starts_with(name) ? text.substr(name.size() + 1) : text;
    }
    return "accepted";
  }

  test::Folder folder_;
};

TEST_F(PathFileTest, IsLookedForBesideTheScenarioAndSetsTheStart) {
  const Scenario s = load("x_m,y_m\n-3,2\n-3,9\n0,12\n");
  EXPECT_EQ(s.get<PathSettings>().csv, (folder_.path / "lap.csv").string());
  EXPECT_EQ(s.get<VehicleSettings>().start_x_m, -3.0);
  EXPECT_EQ(s.get<VehicleSettings>().start_y_m, 2.0);
  EXPECT_GT(s.get<VehicleSettings>().start_yaw_rad, 1.5);
  EXPECT_EQ(make_path(s.get<PathSettings>())->at(1e4).y_m, 12.0);
}

TEST_F(PathFileTest, ErrorsNameTheWaypointsLine) {
  EXPECT_THAT(path_refusal("x_m,y_m\n0,0\n10,0\n21,0\n"),
              AllOf(StartsWith("3: 20.5"), HasSubstr("world.half_extent_m = 22")));
  EXPECT_THAT(path_refusal("x_m,y_m\n0,0\n5,0\n5,nan\n"), StartsWith("4: "));
  EXPECT_THAT(path_refusal("x_m,y_m,v_mps\n0,0,1\n5,0,1\n10,0,1\n", {"controller.v.limit=0.9"}),
              AllOf(StartsWith("2: "), HasSubstr("controller.v.limit = 0.9")));
  EXPECT_THAT(path_refusal("x_m,y_m\n0,0\n4,0\n4.05,0.05\n4,0.1\n0,0.1\n"),
              AllOf(StartsWith("3: "), HasSubstr("the path bends with a radius of 0.0")));
}

TEST_F(PathFileTest, ASpeedThatABendDoesNotAllowIsRefused) {
  const std::string rows = "0,0,1\n4,0,1\n6,2,1.5\n4,4,1\n0,4,1\n";
  EXPECT_THAT(path_refusal("x_m,y_m,v_mps\n" + rows,
                           {"path.max_lateral_acceleration_mps2=0.5", "path.max_yaw_rate_radps=5"}),
              AllOf(StartsWith("4: v_mps = 1.5 is not possible"),
                    HasSubstr("path.max_lateral_acceleration_mps2 = 0.5 allows")));
  EXPECT_THAT(path_refusal("x_m,y_m,v_mps\n" + rows,
                           {"path.max_lateral_acceleration_mps2=5", "path.max_yaw_rate_radps=0.3"}),
              HasSubstr("path.max_yaw_rate_radps = 0.3 allows"));
}

}  // namespace
}  // namespace tether
