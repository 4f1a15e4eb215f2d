#include "controller/detour/smooth_way.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/base/random.hpp"
#include "common/vehicle/frames.hpp"
#include "common/vehicle/motion_model.hpp"
#include "controller/detour/detour_driver.hpp"
#include "controller/detour/detour_planner.hpp"

namespace tether {
namespace {

/// Limits of a slow remote driver, and less grip than he has.
const PathLimits kLimits{.speed_mps = 0.5,
                         .max_acceleration_mps2 = 0.4,
                         .max_deceleration_mps2 = 0.3,
                         .max_lateral_acceleration_mps2 = 0.2,
                         .max_yaw_rate_radps = 0.5};
constexpr double kRounding = 1e-6;

/// Up to six boxes before a vehicle, and where it is to go.
struct Scene {
  explicit Scene(std::uint64_t seed) : floor({0.0, 0.0}, 16.0) {
    RandomEngine random = random_stream(seed, "scene");
    const auto between = [&random](double a, double b) { return a + (b - a) * uniform_01(random); };
    const auto count = static_cast<int>(between(1.0, 7.0));
    for (int i = 0; i < count; ++i) {
      Shape box;
      box.pose = {between(2.7, 9.0), between(-3.0, 3.0), between(-1.5, 1.5)};
      box.length_m = between(0.3, 1.5);
      box.width_m = between(0.3, 1.5);
      floor.add(box);
    }
    std::vector<Pose2> goals;
    for (int i = 0; i < 20; ++i) goals.push_back({11.0 + 0.1 * i, 0.0, 0.0});
    plan = planner.plan(floor, {}, goals).value_or(std::vector<Pose2>{});
    legs = smooth_way(
        plan, kLimits, [this](const Pose2& at) { return planner.room(floor, at); },
        planner.config().gap_m);
  }

  double around_m(const PathPoint& p) const {
    return planner.room(floor, {p.x_m, p.y_m, p.yaw_rad}).around_m;
  }

  DetourPlanner planner{{}};
  FloorMap floor;
  std::vector<Pose2> plan;
  std::vector<WayLeg> legs;
};

/// Each once; all but a few have a way.
const std::vector<Scene>& scenes() {
  static const std::vector<Scene> all = [] {
    std::vector<Scene> scenes;
    for (std::uint64_t seed = 1; seed <= 12; ++seed) scenes.emplace_back(seed);
    return scenes;
  }();
  return all;
}

TEST(SmoothWay, KeepsSpeedYawRateAndAccelerationsOfThePathInRandomScenes) {
  for (const Scene& scene : scenes()) {
    for (const WayLeg& leg : scene.legs) {
      if (leg.path == nullptr) continue;
      const std::vector<SpeedProfile::Motion> steps = leg.path->profile().steps();
      EXPECT_EQ(steps.front().v_mps, 0.0);
      EXPECT_EQ(steps.back().v_mps, 0.0);
      for (std::size_t i = 1; i < steps.size(); ++i) {
        const double v = steps[i].v_mps;
        const double bend = std::abs(leg.path->curve().at(steps[i].s_m).curvature_1pm);
        const double a = (v - steps[i - 1].v_mps) / (steps[i].t_s - steps[i - 1].t_s);
        ASSERT_LE(v, kLimits.speed_mps + kRounding);
        ASSERT_LE(bend, kSharpestWay_1pm + 0.1);  // between the places that were looked at
        ASSERT_LE(v * v * bend, kLimits.max_lateral_acceleration_mps2 + kRounding);
        ASSERT_LE(v * bend, kLimits.max_yaw_rate_radps + kRounding);
        ASSERT_LE(a, kLimits.max_acceleration_mps2 + kRounding);
        ASSERT_GE(a, -kLimits.max_deceleration_mps2 - kRounding);
      }
    }
  }
}

TEST(SmoothWay, KeepsAsFarFromWhatStandsThereAsThePlan) {
  int ways = 0;
  for (const Scene& scene : scenes()) {
    ways += scene.plan.empty() ? 0 : 1;
    for (const WayLeg& leg : scene.legs) {
      if (leg.path == nullptr) continue;
      for (const SpeedProfile::Motion& step : leg.path->profile().steps()) {
        ASSERT_GE(scene.around_m(leg.path->point(step)),
                  scene.planner.config().gap_m - kLessRoom_m - kRounding);
      }
    }
  }
  EXPECT_GE(ways, 10);
}

TEST(SmoothWay, IsFromThePlansStartToItsEndAndStopsOnlyForTurnsOnTheSpot) {
  for (const Scene& scene : scenes()) {
    if (scene.plan.empty()) continue;
    Pose2 at = scene.plan.front();
    bool drove = false;
    for (const WayLeg& leg : scene.legs) {
      ASSERT_NEAR(leg.from.x_m, at.x_m, 1e-6);
      ASSERT_NEAR(leg.from.y_m, at.y_m, 1e-6);
      ASSERT_FALSE(drove && leg.path != nullptr);
      drove = leg.path != nullptr;
      if (!drove) continue;
      const PathCurve& curve = leg.path->curve();
      ASSERT_NEAR(wrap_angle(curve.at(0.0).yaw_rad - leg.from.yaw_rad), 0.0, 0.1);
      const CurvePoint end = curve.at(curve.length_m());
      at = {end.x_m, end.y_m, end.yaw_rad};
    }
    EXPECT_NEAR(at.x_m, scene.plan.back().x_m, 1e-6);
    EXPECT_NEAR(at.y_m, scene.plan.back().y_m, 1e-6);
  }
}

TEST(SmoothWay, OfATurnOnTheSpotBeyondHalfACircleIsATurnThatWayAround) {
  std::vector<Pose2> plan;
  for (int i = 0; i <= 14; ++i) plan.push_back({1.0, 2.0, wrap_angle(i * 0.26)});
  const std::vector<WayLeg> legs = smooth_way(
      plan, kLimits,
      [](const Pose2&) {
        return Room{1.0, 1.0};
      },
      0.2);
  ASSERT_EQ(legs.size(), 1U);
  EXPECT_EQ(legs.front().path, nullptr);
  EXPECT_NEAR(legs.front().turn_rad, 14 * 0.26, 1e-9);
}

TEST(WayFollower, KeepsAVehicleWithLimitedWheelsOnTheWayUntilItsEnd) {
  const VehicleConfig vehicle;
  const MotionModel model({vehicle.track_m, vehicle.max_wheel_acceleration_mps2, 10.0});
  constexpr double kStep_s = 0.05;
  for (const Scene& scene : scenes()) {
    if (scene.plan.empty()) continue;
    WayFollower follower(scene.legs, kLimits);
    MotionModel::State state;
    for (int i = 0; i < 4000; ++i) {
      const Twist twist = follower.drive(state.pose);
      if (i > 0 && twist.v_mps == 0.0 && twist.omega_radps == 0.0) break;
      ASSERT_LE(twist.v_mps, kLimits.speed_mps + kRounding);
      ASSERT_LE(std::abs(twist.omega_radps), kLimits.max_yaw_rate_radps + kRounding);
      model.advance(state, twist, kStep_s);
      ASSERT_LT(follower.off_m(state.pose), 0.15);
      const Pose2& at = state.pose;
      ASSERT_GE(scene.around_m({at.x_m, at.y_m, at.yaw_rad}), scene.planner.config().gap_m - 0.15);
    }
    EXPECT_NEAR(state.pose.x_m, scene.plan.back().x_m, 0.15);
    EXPECT_NEAR(state.pose.y_m, scene.plan.back().y_m, 0.15);
  }
}

}  // namespace
}  // namespace tether
