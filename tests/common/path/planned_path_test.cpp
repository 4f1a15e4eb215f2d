#include "common/path/planned_path.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/path/simple_curves.hpp"
#include "common/path/waypoint_curve.hpp"
#include "common/vehicle/pose.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

/// A path of each kind, away from the origin where the kind has a start.
std::vector<PathSettings> one_of_each() {
  std::vector<PathSettings> paths;
  for (const char* kind : {"circle", "line", "rounded_rectangle", "csv"}) {
    PathSettings path;
    path.kind = kind;
    path.start = {3.0, -2.0, 2.5};
    path.csv = in_source("/scenarios/paths/warehouse_lap.csv");
    paths.push_back(path);
  }
  paths[0].clockwise = true;
  paths[2].limits.speed_mps = 2.5;  // slows down at its corners
  return paths;
}

/// Until the second flying lap, or 2 s after the end.
double long_enough_s(const PlannedPath& path) {
  return path.profile().first_s() + 2.0 * path.profile().lap_s() + 2.0;
}

TEST(PlannedPath, ItsTwistIsTheDerivativeOfItsPoints) {
  for (const PathSettings& config : one_of_each()) {
    const auto path = plan_path(config);
    constexpr double kStep_s = 1e-4;
    for (double t_s = 0.05; t_s < long_enough_s(*path); t_s += 0.0371) {
      const PathPoint before = path->at(t_s - kStep_s), point = path->at(t_s),
                      after = path->at(t_s + kStep_s);
      const double vx = (after.x_m - before.x_m) / (2.0 * kStep_s);
      const double vy = (after.y_m - before.y_m) / (2.0 * kStep_s);
      // Accelerations change by up to 1 m/s² from one step to the next: 1 * kStep_s.
      EXPECT_NEAR(point.v_mps, std::hypot(vx, vy), 2e-4) << t_s;
      EXPECT_NEAR(point.omega_radps, wrap_angle(after.yaw_rad - before.yaw_rad) / (2.0 * kStep_s),
                  5e-4)
          << t_s;
      if (point.v_mps < 0.01) continue;
      EXPECT_NEAR(wrap_angle(point.yaw_rad - std::atan2(vy, vx)), 0.0, 1e-4) << t_s;
    }
  }
}

TEST(PlannedPath, KeepsItsLimitsEverywhere) {
  for (const PathSettings& config : one_of_each()) {
    const auto path = plan_path(config);
    const PathLimits& limits = config.limits;
    constexpr double kStep_s = 0.01;
    constexpr double kSlack = 1.0001;
    for (double t_s = 0.0; t_s < long_enough_s(*path); t_s += kStep_s) {
      const PathPoint a = path->at(t_s), b = path->at(t_s + kStep_s);
      EXPECT_LE(a.v_mps, limits.speed_mps + 1e-9) << t_s;
      EXPECT_LE(a.v_mps * std::abs(a.omega_radps), limits.max_lateral_acceleration_mps2 * kSlack);
      EXPECT_LE(std::abs(a.omega_radps), limits.max_yaw_rate_radps * kSlack) << t_s;
      const double acceleration = (b.v_mps - a.v_mps) / kStep_s;
      EXPECT_LE(acceleration, limits.max_acceleration_mps2 * kSlack) << t_s;
      EXPECT_GE(acceleration, -limits.max_deceleration_mps2 * kSlack) << t_s;
      EXPECT_LE(std::abs(b.omega_radps - a.omega_radps) / kStep_s,
                limits.max_yaw_acceleration_radps2 * kSlack)
          << t_s;
    }
  }
}

TEST(PlannedPath, BeginsAtRestAndRestsBeforeItBegins) {
  for (const PathSettings& config : one_of_each()) {
    const auto path = plan_path(config);
    for (const double t_s : {-5.0, 0.0}) {
      EXPECT_EQ(path->at(t_s).v_mps, 0.0);
      EXPECT_EQ(path->at(t_s).omega_radps, 0.0);
      EXPECT_EQ(path->at(t_s).x_m, path->at(0.0).x_m);
    }
    EXPECT_GT(path->at(0.1).v_mps, 0.0);
  }
}

TEST(PlannedPath, IsWhatMakePathMakes) {
  for (const PathSettings& config : one_of_each()) {
    EXPECT_EQ(make_path(config)->at(7.0).x_m, plan_path(config)->at(7.0).x_m);
  }
}

TEST(PlannedPath, LapsAreTheSameForEver) {
  for (const PathSettings& config : one_of_each()) {
    const auto path = plan_path(config);
    if (!path->curve().is_closed()) continue;
    const double lap_s = path->profile().lap_s();
    for (double t_s = path->profile().first_s() + 0.1; t_s < 100.0; t_s += 3.7) {
      const PathPoint first = path->at(t_s), late = path->at(t_s + 1000.0 * lap_s);
      EXPECT_NEAR(first.x_m, late.x_m, 1e-8);
      EXPECT_NEAR(first.y_m, late.y_m, 1e-8);
      EXPECT_NEAR(first.v_mps, late.v_mps, 1e-8);
    }
  }
}

TEST(LinePath, IsATrapezoidOfSpeedFromRestToRest) {
  PathSettings config;
  config.kind = "line";
  config.length_m = 15.0;
  config.start = {1.0, 2.0, kPi / 2.0};
  config.limits.speed_mps = 1.5;
  config.limits.max_acceleration_mps2 = 0.5;
  config.limits.max_deceleration_mps2 = 0.75;
  const auto path = plan_path(config);
  // 3 s and 2.25 m to speed up, 2 s and 1.5 m to slow down, 11.25 m at 1.5 m/s.
  EXPECT_NEAR(path->profile().first_s(), 3.0 + 7.5 + 2.0, 0.01);
  EXPECT_NEAR(path->at(2.0).v_mps, 1.0, 1e-9);
  EXPECT_NEAR(path->at(2.0).y_m, 2.0 + 1.0, 1e-9);
  EXPECT_NEAR(path->at(6.0).v_mps, 1.5, 1e-12);
  EXPECT_NEAR(path->at(1e6).y_m, 17.0, 1e-12);
  EXPECT_NEAR(path->at(1e6).x_m, 1.0, 1e-12);
  EXPECT_EQ(path->at(1e6).v_mps, 0.0);
  EXPECT_NEAR(path->at(1e6).yaw_rad, kPi / 2.0, 1e-12);
}

TEST(LinePath, TooShortForItsSpeedIsATriangle) {
  PathSettings config;
  config.kind = "line";
  config.length_m = 1.0;
  const auto path = plan_path(config);
  // v² = 2 · 0.5 · 0.5 in the middle.
  EXPECT_NEAR(path->at(0.5 * path->profile().first_s()).v_mps, std::sqrt(0.5), 1e-2);
  EXPECT_NEAR(path->profile().first_s(), 2.0 * std::sqrt(2.0), 1e-6);
}

TEST(CirclePath, RunsAtConstantSpeedOnceItIsFast) {
  PathSettings config;
  config.kind = "circle";
  config.radius_m = 5.0;
  const auto path = plan_path(config);
  EXPECT_NEAR(path->profile().first_s(), 3.0, 0.05);  // a step is 0.03 s
  EXPECT_NEAR(path->profile().lap_s(), 10.0 * kPi / 1.5, 1e-9);
  for (double t_s = 0.0; t_s < 60.0; t_s += 0.7) {
    const PathPoint p = path->at(t_s);
    EXPECT_NEAR(std::hypot(p.x_m, p.y_m - 5.0), 5.0, 1e-12);
  }
  EXPECT_NEAR(path->at(10.0).omega_radps, 0.3, 1e-12);
  config.clockwise = true;
  EXPECT_NEAR(plan_path(config)->at(10.0).omega_radps, -0.3, 1e-12);
  EXPECT_NEAR(plan_path(config)->at(10.0).y_m, -path->at(10.0).y_m, 1e-12);
}

TEST(CirclePath, ALapMayBeTooShortToReachTheSpeed) {
  PathSettings config;
  config.kind = "circle";
  config.radius_m = 1.0;
  config.limits = {.speed_mps = 3.0,
                   .max_acceleration_mps2 = 0.1,
                   .max_lateral_acceleration_mps2 = 50.0,
                   .max_yaw_rate_radps = 50.0};
  const auto path = plan_path(config);
  EXPECT_NEAR(path->profile().first_s(), 30.0, 0.1);  // 45 m, seven laps
  EXPECT_NEAR(path->at(20.0).v_mps, 2.0, 1e-9);
  EXPECT_NEAR(std::hypot(path->at(20.0).x_m, path->at(20.0).y_m - 1.0), 1.0, 1e-12);
}

TEST(ClothoidCorner, TurnsBy90DegreesWithAContinuousCurvature) {
  const ClothoidCorner corner(2.0);
  const CurvePoint end = corner.at(corner.length_m());
  EXPECT_NEAR(end.x_m, corner.reach_m(), 1e-12);
  EXPECT_NEAR(end.y_m, corner.reach_m(), 1e-12);
  EXPECT_NEAR(end.yaw_rad, kPi / 2.0, 1e-12);
  EXPECT_NEAR(end.curvature_1pm, 0.0, 1e-12);
  EXPECT_NEAR(corner.reach_m(), 1.87 * 2.0, 0.01);
  double sharpest = 0.0;
  for (double s_m = 0.0; s_m + 1e-3 < corner.length_m(); s_m += 1e-3) {
    const CurvePoint a = corner.at(s_m), b = corner.at(s_m + 1e-3);
    EXPECT_NEAR(std::hypot(b.x_m - a.x_m, b.y_m - a.y_m), 1e-3, 1e-9);
    EXPECT_NEAR(b.yaw_rad - a.yaw_rad, 0.5e-3 * (a.curvature_1pm + b.curvature_1pm), 1e-6);
    sharpest = std::max(sharpest, a.curvature_1pm);
  }
  EXPECT_NEAR(sharpest, 1.0 / 2.0, 1e-3);
}

TEST(RoundedRectangle, GoesAroundItsOutline) {
  for (const bool clockwise : {false, true}) {
    const RoundedRectangleCurve curve({}, {10.0, 8.0, 1.5, clockwise});
    double west = 0.0, east = 0.0, south = 0.0, north = 0.0, turned = 0.0;
    CurvePoint last = curve.at(0.0);
    for (double s_m = 0.0; s_m <= curve.length_m(); s_m += 1e-2) {
      const CurvePoint p = curve.at(s_m);
      west = std::min(west, p.x_m), east = std::max(east, p.x_m);
      south = std::min(south, p.y_m), north = std::max(north, p.y_m);
      turned += wrap_angle(p.yaw_rad - last.yaw_rad);
      EXPECT_LE(std::hypot(p.x_m - last.x_m, p.y_m - last.y_m), 1e-2 + 1e-12);
      last = p;
    }
    EXPECT_NEAR(west, -5.0, 1e-12);
    EXPECT_NEAR(east, 5.0, 1e-12);
    EXPECT_NEAR(clockwise ? -south : north, 8.0, 1e-12);
    EXPECT_NEAR(clockwise ? north : south, 0.0, 1e-12);
    EXPECT_NEAR(turned, clockwise ? -2.0 * kPi : 2.0 * kPi, 1e-9);
    EXPECT_NEAR(curve.at(curve.length_m()).x_m, 0.0, 1e-9);
  }
}

TEST(RoundedRectangle, RefusesCornersThatDoNotFit) {
  try {
    const RoundedRectangleCurve curve({}, {10.0, 5.0, 2.0, false});
    FAIL() << "accepted";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), HasSubstr("path.corner_radius_m = 2 does not fit"));
    EXPECT_THAT(error.what(), HasSubstr("path.width_m"));
  }
}

WaypointCurve curve_through(const std::string& rows) {
  std::istringstream in("x_m,y_m\n" + rows);
  return WaypointCurve(read_waypoints(in, "a.csv"));
}

/// n points of a circle of 5 m around the origin, closed.
std::string circle_rows(int n) {
  std::ostringstream rows;
  rows.precision(17);
  for (int i = 0; i <= n; ++i) {
    const double angle = 2.0 * kPi * (i % n) / n;
    rows << 5.0 * std::cos(angle) << ',' << 5.0 * std::sin(angle) << '\n';
  }
  return rows.str();
}

TEST(WaypointCurve, AClosedOneThroughPointsOfACircleIsNearlyThatCircle) {
  const WaypointCurve curve = curve_through(circle_rows(24));
  EXPECT_TRUE(curve.is_closed());
  EXPECT_NEAR(curve.length_m(), 10.0 * kPi, 1e-3);
  for (double s_m = 0.0; s_m < curve.length_m(); s_m += 0.1) {
    const CurvePoint p = curve.at(s_m);
    EXPECT_NEAR(std::hypot(p.x_m, p.y_m), 5.0, 1e-3);
    EXPECT_NEAR(p.curvature_1pm, 0.2, 2e-2 * 0.2);
  }
}

TEST(WaypointCurve, IsParametrisedByArcLengthAndHasAContinuousCurvature) {
  const WaypointCurve curve = curve_through("0,0\n5,0\n8,4\n3,9\n-2,7\n-3,2\n0,0\n");
  constexpr double kStep_m = 1e-3;
  CurvePoint last = curve.at(curve.length_m());
  for (double s_m = 0.0; s_m < curve.length_m(); s_m += kStep_m) {
    const CurvePoint p = curve.at(s_m);
    const double moved_m = std::hypot(p.x_m - last.x_m, p.y_m - last.y_m);
    EXPECT_NEAR(moved_m, s_m > 0.0 ? kStep_m : 0.0, 1e-8) << s_m;
    EXPECT_NEAR(p.curvature_1pm, last.curvature_1pm, 2.0 * kStep_m) << s_m;
    last = p;
  }
}

TEST(WaypointCurve, PassesItsWaypoints) {
  const WaypointCurve curve = curve_through("0,0\n5,0\n8,4\n3,9\n");
  EXPECT_FALSE(curve.is_closed());
  const double wanted[][2] = {{0.0, 0.0}, {5.0, 0.0}, {8.0, 4.0}, {3.0, 9.0}};
  for (std::size_t i = 0; i < 4; ++i) {
    const CurvePoint p = curve.at(curve.waypoints_s_m()[i]);
    EXPECT_NEAR(p.x_m, wanted[i][0], 1e-9);
    EXPECT_NEAR(p.y_m, wanted[i][1], 1e-9);
  }
  EXPECT_NEAR(curve.at(0.0).curvature_1pm, 0.0, 1e-12);
  EXPECT_NEAR(curve.at(curve.length_m()).curvature_1pm, 0.0, 1e-9);
}

TEST(WaypointCurve, TwoWaypointsAreALine) {
  const WaypointCurve curve = curve_through("1,1\n4,5\n");
  EXPECT_NEAR(curve.length_m(), 5.0, 1e-12);
  EXPECT_NEAR(curve.at(2.5).x_m, 2.5, 1e-12);
  EXPECT_NEAR(curve.at(2.5).y_m, 3.0, 1e-12);
  EXPECT_EQ(curve.at(2.5).curvature_1pm, 0.0);
}

TEST(WaypointCurve, WantedSpeedsArePassedOnAndAcceleratedBetween) {
  std::istringstream in("x_m,y_m,v_mps\n0,0,0\n4,0,1\n8,0,1\n10,0,0.5\n");
  const WaypointCurve curve(read_waypoints(in, "a.csv"));
  EXPECT_EQ(curve.wanted_speed_mps(0.0), 0.0);
  EXPECT_NEAR(curve.wanted_speed_mps(1.0), 0.5, 1e-9);  // v² = s/4
  EXPECT_NEAR(curve.wanted_speed_mps(6.0), 1.0, 1e-9);
  EXPECT_NEAR(curve.wanted_speed_mps(10.0), 0.5, 1e-9);
  const SpeedProfile profile(curve, {});
  for (const SpeedProfile::Motion& step : profile.steps()) {
    EXPECT_LE(step.v_mps, curve.wanted_speed_mps(step.s_m) + 1e-9);
  }
}

}  // namespace
}  // namespace tether
