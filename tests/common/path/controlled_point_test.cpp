#include "common/path/controlled_point.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

constexpr double kAhead_m = 0.5;

Scenario parse(const std::vector<std::string>& overrides) {
  return parse_scenario("", "test.toml", overrides);
}

std::shared_ptr<const ReferencePath> figure_eight() { return make_path(PathSettings{}); }

TEST(ControlledPoint, TheAxlesPathTakesThePointAlongTheOther) {
  const auto path = figure_eight();
  const AxlePath axle_path(path, kAhead_m);
  for (double t_s = 0.0; t_s < 60.0; t_s += 0.37) {
    const PathPoint axle = axle_path.at(t_s);
    const Position point = point_ahead({axle.x_m, axle.y_m, axle.yaw_rad}, kAhead_m);
    EXPECT_NEAR(point.x_m, path->at(t_s).x_m, 1e-9);
    EXPECT_NEAR(point.y_m, path->at(t_s).y_m, 1e-9);
  }
}

TEST(ControlledPoint, TheAxleNeverSlipsSideways) {
  const AxlePath axle_path(figure_eight(), kAhead_m);
  constexpr double kStep_s = 1e-3;
  for (double t_s = 0.05; t_s < 60.0; t_s += 0.37) {
    const PathPoint before = axle_path.at(t_s - kStep_s), p = axle_path.at(t_s),
                    after = axle_path.at(t_s + kStep_s);
    const double vx = (after.x_m - before.x_m) / (2 * kStep_s);
    const double vy = (after.y_m - before.y_m) / (2 * kStep_s);
    const double c = std::cos(p.yaw_rad), s = std::sin(p.yaw_rad);
    // A heading is off by at most step²/8 · |d²θ/dt²|, 1e-5 rad, between two steps of 10 ms.
    EXPECT_NEAR(c * vy - s * vx, 0.0, 1e-2);
    EXPECT_NEAR(c * vx + s * vy, p.v_mps, 1e-3);
    EXPECT_NEAR(wrap_angle(after.yaw_rad - before.yaw_rad) / (2 * kStep_s), p.omega_radps, 1e-2);
  }
}

TEST(ControlledPoint, OnACircleTheAxleRunsInsideAndTrails) {
  PathSettings circle;
  circle.kind = "circle";
  circle.radius_m = 4.0;
  const auto path = make_path(circle);
  const PathPoint p = path->at(15.0), axle = AxlePath(path, kAhead_m).at(15.0);
  EXPECT_NEAR(wrap_angle(p.yaw_rad - axle.yaw_rad), std::asin(kAhead_m / 4.0), 1e-4);
  EXPECT_NEAR(axle.omega_radps, p.omega_radps, 1e-4);
  EXPECT_NEAR(axle.v_mps / axle.omega_radps, std::sqrt(16.0 - 0.25), 1e-3);
}

TEST(ControlledPoint, AnswersDoNotDependOnWhatWasAskedBefore) {
  const AxlePath once(figure_eight(), kAhead_m), often(figure_eight(), kAhead_m);
  for (double t_s = -30.0; t_s < 40.0; t_s += 0.1) often.at(t_s);
  EXPECT_EQ(once.at(33.333).yaw_rad, often.at(33.333).yaw_rad);
}

TEST(ControlledPoint, PathsPutItOnTheirStart) {
  const Scenario s = parse(
      {"path.kind=line", "path.start_x_m=-5", "path.start_yaw_rad=0.5", "path.point=chassis"});
  const auto& vehicle = s.get<VehicleSettings>();
  const Position point = point_ahead({vehicle.start_x_m, vehicle.start_y_m, vehicle.start_yaw_rad},
                                     controlled_point_ahead_m(s.get<PathSettings>(), vehicle));
  EXPECT_NEAR(point.x_m, -5.0, 1e-12);
  EXPECT_NEAR(point.y_m, 0.0, 1e-12);
}

TEST(ControlledPoint, OfAVehicleWithItsAxleInFrontIsRefused) {
  for (const char* axle : {"vehicle.axle_x_m=0.3", "vehicle.axle_x_m=0"}) {
    try {
      parse({"path.point=chassis", axle});
      FAIL() << axle;
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr("path.point = \"chassis\""));
      EXPECT_THAT(error.what(), HasSubstr("vehicle.axle_x_m"));
    }
    EXPECT_NO_THROW(parse({"path.point=axle", axle}));
  }
}

}  // namespace
}  // namespace tether
