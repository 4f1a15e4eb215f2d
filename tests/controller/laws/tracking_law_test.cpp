#include "controller/laws/tracking_law.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <numbers>

#include "controller/laws/controller_settings.hpp"
#include "tests/controller/laws/laws_rig.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using test::at_s;
using test::LawRig;
using test::with_law;

PathPoint reference(double x_m, double y_m, double yaw_rad, double v_mps, double omega_radps) {
  return {x_m, y_m, yaw_rad, v_mps, omega_radps};
}

TEST(TrackingFeedback, OnThePathItIsThePathsOwnTwist) {
  const TrackingFeedback feedback({}, 3.0);
  const Twist u = feedback.command({3.0, -2.0, 1.0}, reference(3.0, -2.0, 1.0, 2.5, 0.3));
  EXPECT_DOUBLE_EQ(u.v_mps, 2.5);
  EXPECT_DOUBLE_EQ(u.omega_radps, 0.3);
}

TEST(TrackingFeedback, ForSmallErrorsItIsKanayamasLaw) {
  ControllerSettings config;
  config.tracking = {.k_x = 2.0, .k_y = 0.7, .k_theta = 1.5, .max_lateral_mps2 = 3.0};
  const TrackingFeedback feedback(config, 3.0);
  const double e = 1e-4;  // the rest is of second order
  const Twist ahead = feedback.command({}, reference(e, 0.0, 0.0, 2.0, 0.1));
  EXPECT_NEAR(ahead.v_mps, 2.0 + 2.0 * e, 1e-7);
  EXPECT_NEAR(ahead.omega_radps, 0.1, 1e-7);
  const Twist aside = feedback.command({}, reference(0.0, e, 0.0, 2.0, 0.1));
  EXPECT_NEAR(aside.v_mps, 2.0, 1e-7);
  EXPECT_NEAR(aside.omega_radps, 0.1 + 2.0 * 0.7 * e, 1e-7);
  const Twist turned = feedback.command({}, reference(0.0, 0.0, e, 2.0, 0.1));
  EXPECT_NEAR(turned.omega_radps, 0.1 + 2.0 * 1.5 * e, 1e-7);
}

TEST(TrackingFeedback, StaysWithinItsLimitsHoweverFarThePathIs) {
  const ControllerSettings config;
  const TrackingFeedback feedback(config, 3.0);
  for (double x = -40.0; x <= 40.0; x += 7.0) {
    for (double y = -40.0; y <= 40.0; y += 7.0) {
      for (double yaw = -3.0; yaw <= 3.0; yaw += 0.5) {
        const Twist u = feedback.command({}, reference(x, y, yaw, 2.5, 0.3));
        EXPECT_LE(std::abs(u.v_mps), config.v.limit);
        EXPECT_LE(std::abs(u.omega_radps), config.omega.limit);
        EXPECT_TRUE(std::abs(u.v_mps) <= 2.5 ||
                    std::abs(u.v_mps * u.omega_radps) <= config.tracking.max_lateral_mps2 + 1e-9);
      }
    }
  }
}

TEST(TrackingFeedback, CatchingUpBrakesWithNineTenthsOfTheVehiclesAcceleration) {
  const TrackingFeedback feedback({}, 3.0);
  const auto v_mps = [&](double ahead_m) {
    return feedback.command({}, reference(ahead_m, 0.0, 0.0, 0.0, 0.0)).v_mps;
  };
  // From v²/2 = a s; where |x_e| is beyond what K_x x_e serves, and below the limit of speed.
  const double a_mps2 = (v_mps(2.5) * v_mps(2.5) - v_mps(2.0) * v_mps(2.0)) / (2.0 * 0.5);
  EXPECT_NEAR(a_mps2, 0.9 * 3.0, 1e-9);
}

TEST(TrackingLaw, CatchesUpFromRestAlmostAsFastAsTheVehicleCan) {
  LawRig rig(with_law("tracking"));
  double integral = 0.0, furthest_ahead_m = 0.0;
  Twist u;
  for (Instant t = kStart; t < at_s(62); t += milliseconds{50}) {
    const SeenPose seen = rig.seen(t);
    u = std::get<Twist>(rig.law->decide(t, &seen));
    integral += rig.error_m(t) * 0.05;
    const PathPoint p = rig.path->at(to_seconds(t));
    const double ahead_m = std::cos(p.yaw_rad) * (rig.vehicle.pose.x_m - p.x_m) +
                           std::sin(p.yaw_rad) * (rig.vehicle.pose.y_m - p.y_m);
    if (t > at_s(2)) furthest_ahead_m = std::max(furthest_ahead_m, ahead_m);
    rig.drive(t, t + milliseconds{50}, [&](Instant) { return u; });
  }
  // No vehicle with 3 m/s² that starts at rest can be below 0.0276 m: the path begins at 2.83 m/s.
  EXPECT_GT(integral / 62.0, 0.0270);
  EXPECT_LT(integral / 62.0, 0.0320);
  EXPECT_LT(furthest_ahead_m, 0.05);
}

TEST(TrackingLaw, FindsBackFromAnywhereAndAnyHeading) {
  for (const double yaw : {-3.1, -1.5, 0.0, 1.5, 3.1}) {
    for (const double x : {-15.0, 0.0, 15.0}) {
      LawRig rig(with_law("tracking"));
      rig.vehicle.pose = {x, -10.0, yaw};
      for (Instant t = kStart; t < at_s(30); t += milliseconds{50}) {
        const SeenPose seen = rig.seen(t);
        const Twist u = std::get<Twist>(rig.law->decide(t, &seen));
        rig.drive(t, t + milliseconds{50}, [&](Instant) { return u; });
      }
      EXPECT_LT(rig.error_m(at_s(30)), 0.1) << "from x " << x << " m, yaw " << yaw;
    }
  }
}

/// The mean error from 10 s on, with `delay` each way.
double error_with_delay_m(const std::string& law, Duration delay) {
  LawRig rig(with_law(law));
  std::deque<SeenPose> poses;
  std::deque<std::pair<Instant, Twist>> commands;
  Twist u;
  double sum = 0.0;
  for (Instant t = kStart; t < at_s(40); t += milliseconds{50}) {
    while (!commands.empty() && commands.front().first <= t) {
      u = commands.front().second;
      commands.pop_front();
    }
    poses.push_back(rig.seen(t, delay));
    if (poses.front().arrival <= t) {
      rig.law->on_pose(poses.front());
      commands.emplace_back(t + delay, std::get<Twist>(rig.law->decide(t, &poses.front())));
      poses.pop_front();
    }
    if (t >= at_s(10)) sum += rig.error_m(t) / 600.0;
    rig.drive(t, t + milliseconds{50}, [&](Instant) { return u; });
  }
  return sum;
}

TEST(CompensatedTrackingLaw, FollowsDespiteDelayThatTheOtherDoesNotSurvive) {
  EXPECT_LT(error_with_delay_m("tracking_compensated", milliseconds{500}), 0.05);
  EXPECT_GT(error_with_delay_m("tracking", milliseconds{500}), 1.0);
}

TEST(CompensatedTrackingLaw, WithoutDelayItDecidesAsTheOther) {
  LawRig plain(with_law("tracking")), compensated(with_law("tracking_compensated"));
  for (int i = 0; i < 20; ++i) {
    const Instant t = at_s(i);
    plain.vehicle.pose = {0.3 * i, -0.1 * i, 0.2 * i};
    const SeenPose seen = plain.seen(t);
    compensated.law->on_pose(seen);
    const Twist a = std::get<Twist>(plain.law->decide(t, &seen));
    const Twist b = std::get<Twist>(compensated.law->decide(t, &seen));
    EXPECT_DOUBLE_EQ(a.v_mps, b.v_mps);
    EXPECT_DOUBLE_EQ(a.omega_radps, b.omega_radps);
  }
}

TEST(MotionModel, AcceleratesEachWheelWithinItsLimitAndRollsTheExactDistance) {
  const MotionModel model({.track_m = 1.2, .max_wheel_acceleration_mps2 = 2.0});
  MotionModel::State state;
  model.advance(state, {1.0, 0.0}, 2.0);  // 0.5 s up to speed, 0.25 m; 1.5 s at it
  EXPECT_DOUBLE_EQ(state.rim.left_mps, 1.0);
  EXPECT_DOUBLE_EQ(state.pose.x_m, 1.75);
  EXPECT_DOUBLE_EQ(state.pose.y_m, 0.0);
}

TEST(MotionModel, AtConstantSpeedsItDrivesTheExactArc) {
  const MotionModel model({});
  MotionModel::State state{{}, model.rim_of({2.0, 0.5})};
  for (int i = 0; i < 100; ++i) model.advance(state, {2.0, 0.5}, 0.05);
  EXPECT_NEAR(state.pose.x_m, 4.0 * std::sin(2.5), 1e-9);
  EXPECT_NEAR(state.pose.y_m, 4.0 * (1.0 - std::cos(2.5)), 1e-9);
  EXPECT_NEAR(state.pose.yaw_rad, 2.5, 1e-12);
}

TEST(MotionModel, CoarseStepsAreNearFineOnes) {
  const MotionModel model({});
  MotionModel::State coarse, fine;
  for (int i = 0; i < 40; ++i) {
    const Twist u{2.0 + std::sin(0.3 * i), std::cos(0.5 * i)};
    model.advance(coarse, u, 0.05);
    for (int k = 0; k < 50; ++k) model.advance(fine, u, 0.001);
  }
  EXPECT_NEAR(coarse.pose.x_m, fine.pose.x_m, 2e-3);
  EXPECT_NEAR(coarse.pose.y_m, fine.pose.y_m, 2e-3);
  EXPECT_NEAR(coarse.pose.yaw_rad, fine.pose.yaw_rad, 1e-9);
}

TEST(MotionModel, SaysWhatTwistIsInReach) {
  const MotionModel model({.track_m = 1.2, .max_wheel_acceleration_mps2 = 3.0});
  const Twist u = model.reachable({1.0, 1.0}, {5.0, 0.0}, 0.1);
  EXPECT_DOUBLE_EQ(u.v_mps, 1.3);
  EXPECT_DOUBLE_EQ(u.omega_radps, 0.0);
}

}  // namespace
}  // namespace tether
