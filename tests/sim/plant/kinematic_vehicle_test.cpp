// The kinematic plant alone: free driving against closed forms and against ODE, and its walls.

#include "sim/plant/kinematic_vehicle.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "common/vehicle/vehicle_settings.hpp"
#include "sim/plant/ode_vehicle.hpp"
#include "tests/sim/plant/plant_rig.hpp"

namespace tether {
namespace {

using test::kOpenFloor;
using test::kStep;
using test::kStep_s;
using test::run;
using test::wheels;

TEST(KinematicVehicle, AcceleratesAndBrakesStraightWithinTheLimit) {
  KinematicVehicle vehicle({}, kOpenFloor, kStep);
  vehicle.set_wheel_targets(wheels(6.0, 0.0));
  run(vehicle, 1.5);
  EXPECT_NEAR(vehicle.state().twist.v_mps, 3.0 * 1.5, 1e-9);
  EXPECT_NEAR(vehicle.state().pose.x_m, 0.5 * 3.0 * 1.5 * 1.5, 1e-9);
  run(vehicle, 3.5);  // 2 s and 6 m until 6 m/s, then 3 s
  EXPECT_NEAR(vehicle.state().pose.x_m, 6.0 + 18.0, 1e-9);
  vehicle.set_wheel_targets({});
  run(vehicle, 3.0);
  EXPECT_NEAR(vehicle.state().pose.x_m, 24.0 + 6.0, 1e-9);
  EXPECT_EQ(vehicle.state().twist.v_mps, 0.0);
  EXPECT_EQ(vehicle.state().pose.y_m, 0.0);
  EXPECT_NEAR(vehicle.state().left_wheel_angle_rad, 30.0 / VehicleConfig{}.wheel_radius_m, 1e-9);
}

TEST(KinematicVehicle, DrivesACircleExactly) {
  KinematicVehicle vehicle({}, kOpenFloor, kStep);
  vehicle.set_wheel_targets(wheels(1.0, 0.5));
  run(vehicle, 1.0);
  const Pose2 start = vehicle.state().pose;
  run(vehicle, 60.0);
  const Pose2 end = vehicle.state().pose;
  const double a = start.yaw_rad;
  EXPECT_NEAR(wrap_angle(end.yaw_rad - a - 30.0), 0.0, 1e-9);
  EXPECT_NEAR(end.x_m - start.x_m, 2.0 * (std::sin(a + 30.0) - std::sin(a)), 1e-9);
  EXPECT_NEAR(end.y_m - start.y_m, 2.0 * (std::cos(a) - std::cos(a + 30.0)), 1e-9);
  EXPECT_NEAR(vehicle.state().twist.v_mps, 1.0, 1e-12);
  EXPECT_NEAR(vehicle.state().twist.omega_radps, 0.5, 1e-12);
}

TEST(KinematicVehicle, SpinsOnTheSpot) {
  KinematicVehicle vehicle({}, kOpenFloor, kStep);
  vehicle.set_wheel_targets({-1.0, 1.0});
  run(vehicle, 20.0);
  // The rims gain 1 m/s in 1/3 s, on average half as fast; track 1.2 m.
  EXPECT_NEAR(wrap_angle(vehicle.state().pose.yaw_rad - (20.0 - 1.0 / 6.0) * 2.0 / 1.2), 0.0, 1e-6);
  EXPECT_NEAR(std::hypot(vehicle.state().pose.x_m, vehicle.state().pose.y_m), 0.0, 1e-12);
}

TEST(KinematicVehicle, ScalesBothWheelsTogetherAtTheSpeedLimit) {
  KinematicVehicle vehicle({}, kOpenFloor, kStep);
  vehicle.set_wheel_targets({30.0, 27.0});
  run(vehicle, 5.0);
  EXPECT_DOUBLE_EQ(vehicle.state().rim_speeds.left_mps, 10.0);
  EXPECT_DOUBLE_EQ(vehicle.state().rim_speeds.right_mps, 9.0);
}

/// Where half a second of growing and of shrinking curvature ends, with steps of this length.
Pose2 wriggle(Duration step) {
  KinematicVehicle vehicle({}, kOpenFloor, step);
  for (const WheelSpeeds& w : {wheels(8.0, 2.0), wheels(2.0, -2.0), wheels(6.0, 0.0)}) {
    vehicle.set_wheel_targets(w);
    const long steps = std::lround(0.5 / to_seconds(step));
    for (long i = 0; i < steps; ++i) vehicle.step();
  }
  return vehicle.state().pose;
}

TEST(KinematicVehicle, WhileItAcceleratesTheErrorOfAStepIsOfThirdOrder) {
  using std::chrono::microseconds;
  const Pose2 truth = wriggle(microseconds{10});
  const auto error_m = [&truth](Duration step) {
    const Pose2 p = wriggle(step);
    return std::hypot(p.x_m - truth.x_m, p.y_m - truth.y_m);
  };
  // 1500 steps, each off by at most 1e-9/12 s³ · (8 m/s · 5 rad/s² + 2 rad/s · 3 m/s²), and at the
  // end of a ramp by 3 m/s² · (1 ms)²/8: together below 10 µm.
  EXPECT_LT(error_m(microseconds{1000}), 1e-5);
  EXPECT_GT(error_m(microseconds{10'000}), 20.0 * error_m(microseconds{1000}));
}

TEST(KinematicVehicle, CoastsWhereStepsThatAreMuchShorterLead) {
  KinematicVehicle vehicle({}, kOpenFloor, kStep);
  KinematicVehicle finely({}, kOpenFloor, std::chrono::microseconds{2});
  for (const WheelSpeeds& target : {wheels(3.0, 1.0), wheels(0.0, 2.0), wheels(1.8, 0.0)}) {
    vehicle.set_wheel_targets(target);
    finely.set_wheel_targets(target);
    for (std::int64_t left = 1500; left > 0;) left -= vehicle.take(left, kStart).taken;
    for (int i = 0; i < 750'000; ++i) finely.step();
    // All ramps are whole steps. Between the two: 1e6 steps of 2 µs that accelerate, 3e-17 m each;
    // rounding of a million.
    EXPECT_NEAR(vehicle.state().pose.x_m, finely.state().pose.x_m, 1e-9);
    EXPECT_NEAR(vehicle.state().pose.y_m, finely.state().pose.y_m, 1e-9);
    EXPECT_NEAR(vehicle.state().pose.yaw_rad, finely.state().pose.yaw_rad, 1e-9);
    EXPECT_NEAR(vehicle.state().left_wheel_angle_rad, finely.state().left_wheel_angle_rad, 1e-8);
    EXPECT_NEAR(vehicle.state().rim_speeds.right_mps, target.right_mps, 1e-12);
  }
}

/// In a hall, at its walls too, in calls of up to `most` steps; the states at each whole 100 ms.
/// 0: step by step, without coasting.
std::vector<VehicleState> driven(int most) {
  KinematicVehicle vehicle({}, {.half_extent_m = 6.0}, kStep);
  std::vector<VehicleState> states;
  for (int i = 0; i < 40'000;) {
    if (i % 700 == 0) {
      vehicle.set_wheel_targets(wheels(3.0 * std::cos(0.0004 * i), std::sin(0.001 * i)));
    }
    const std::int64_t calls_most = std::min(most, 100 - i % 100);
    if (most == 0) vehicle.step();
    i += most == 0 ? 1 : static_cast<int>(vehicle.take(calls_most, kStart).taken);
    if (i % 100 == 0) states.push_back(vehicle.state());
  }
  return states;
}

TEST(KinematicVehicle, HoweverStepsAreDividedAmongCallsTheStatesAreTheSameToTheBit) {
  const std::vector<VehicleState> one = driven(1);
  bool touched = false;
  for (const int most : {2, 7, 100}) {
    const std::vector<VehicleState> other = driven(most);
    ASSERT_EQ(one.size(), other.size());
    for (std::size_t i = 0; i < one.size(); ++i) {
      ASSERT_EQ(one[i].pose, other[i].pose) << most << " at once, " << i;
      ASSERT_EQ(one[i].left_wheel_angle_rad, other[i].left_wheel_angle_rad);
      ASSERT_EQ(one[i].wall_contact, other[i].wall_contact);
      touched = touched || one[i].wall_contact;
    }
  }
  EXPECT_TRUE(touched);
}

TEST(KinematicVehicle, NeverCoastsThroughAWall) {
  const std::vector<VehicleState> coasting = driven(100), stepping = driven(0);
  ASSERT_EQ(coasting.size(), stepping.size());
  for (std::size_t i = 0; i < coasting.size(); ++i) {
    // A wall turns what differs by a nanometre into no more than this.
    EXPECT_NEAR(coasting[i].pose.x_m, stepping[i].pose.x_m, 1e-5) << i;
    EXPECT_NEAR(coasting[i].pose.y_m, stepping[i].pose.y_m, 1e-5) << i;
    EXPECT_EQ(coasting[i].wall_contact, stepping[i].wall_contact) << i;
  }
}

TEST(KinematicVehicle, FollowsOdeInFreeDrivingForAMinute) {
  KinematicVehicle vehicle({}, kOpenFloor, kStep);
  OdeVehicle ode({}, kOpenFloor, kStep);
  double farthest_m = 0.0;
  for (int i = 0; i < 60'000; ++i) {
    const double t_s = i * kStep_s;
    // Up to 3 m/s and 0.6 rad/s, changed ten times a second: the wheels never skid.
    if (i % 100 == 0) {
      const WheelSpeeds w =
          wheels(2.0 * std::sin(0.3 * t_s) + std::sin(0.9 * t_s), 0.6 * std::sin(0.7 * t_s));
      vehicle.set_wheel_targets(w);
      ode.set_wheel_targets(w);
    }
    vehicle.step();
    ode.step();
    const Pose2 &a = vehicle.state().pose, &b = ode.state().pose;
    farthest_m = std::max(farthest_m, std::hypot(a.x_m - b.x_m, a.y_m - b.y_m));
  }
  EXPECT_LT(farthest_m, 0.02);
  EXPECT_NEAR(wrap_angle(vehicle.state().pose.yaw_rad - ode.state().pose.yaw_rad), 0.0, 2e-3);
}

// ---------------------------------------------------------------------------- walls

/// How far the vehicle's outline reaches beyond the walls; negative: it is inside.
double beyond_walls_m(const Pose2& pose) {
  double farthest_m = 0.0;
  for (const auto& [x, y] : {std::pair{1.5, 0.5}, {-0.5, 0.5}, {0.4, 0.7}, {-0.4, 0.7}}) {
    for (const double side : {-1.0, 1.0}) {
      const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
      farthest_m = std::max({farthest_m, std::abs(pose.x_m + c * x - s * side * y),
                             std::abs(pose.y_m + s * x + c * side * y)});
    }
  }
  return farthest_m - WorldSettings{}.half_extent_m;
}

VehicleConfig at(double x_m, double y_m, double yaw_rad) {
  VehicleConfig config;
  config.start_x_m = x_m;
  config.start_y_m = y_m;
  config.start_yaw_rad = yaw_rad;
  return config;
}

TEST(KinematicVehicle, AWallStopsItNoseOnAndBothWheelsSlip) {
  for (const double v_mps : {1.0, 4.0, 8.0}) {
    KinematicVehicle vehicle(at(10.0, 0.0, 0.0), {}, kStep);
    vehicle.set_wheel_targets(wheels(v_mps, 0.0));
    run(vehicle, 30.0);
    const VehicleState& s = vehicle.state();
    EXPECT_TRUE(s.wall_contact);
    EXPECT_NEAR(s.pose.x_m, 22.0 - 1.5, 1e-6);  // nose to axle: 1.5 m
    EXPECT_EQ(s.twist.v_mps, 0.0);
    EXPECT_NEAR(s.pose.yaw_rad, 0.0, 1e-9);
    EXPECT_DOUBLE_EQ(s.rim_speeds.left_mps, v_mps);
    EXPECT_DOUBLE_EQ(s.rim_speeds.right_mps, v_mps);
    EXPECT_GT(s.left_wheel_angle_rad, 20.0 * v_mps / 0.4);  // they turn all the while
  }
}

TEST(KinematicVehicle, NoseOnItDoesNotFreeItselfWhileBothWheelsPushForward) {
  KinematicVehicle vehicle(at(20.0, 0.0, 0.0), {}, kStep);
  vehicle.set_wheel_targets(wheels(2.0, 0.0));
  run(vehicle, 2.0);
  for (int second = 0; second < 60; ++second) {
    // At 2 m/s this leaves the inner wheel 0.8 m/s forward.
    const double omega_radps = second % 2 == 0 ? 2.0 : -2.0;
    vehicle.set_wheel_targets(wheels(2.0 + second % 7, omega_radps));
    run(vehicle, 1.0);
    ASSERT_NEAR(vehicle.state().pose.x_m, 20.5, 1e-6);
    ASSERT_NEAR(vehicle.state().pose.yaw_rad, 0.0, 1e-6);
    ASSERT_TRUE(vehicle.state().wall_contact);
  }
}

TEST(KinematicVehicle, TurnsAwayFromAWallWithOneWheelInReverse) {
  KinematicVehicle vehicle(at(20.5, 0.0, 0.0), {}, kStep);
  vehicle.set_wheel_targets({-1.0, 1.0});
  run(vehicle, 3.0);
  EXPECT_GT(std::abs(vehicle.state().pose.yaw_rad), 1.0);
}

TEST(KinematicVehicle, LeavesAWallBackwards) {
  KinematicVehicle vehicle(at(18.0, 0.0, 0.0), {}, kStep);
  vehicle.set_wheel_targets(wheels(4.0, 0.0));
  run(vehicle, 5.0);
  vehicle.set_wheel_targets(wheels(-1.0, 0.0));
  run(vehicle, 8.0);
  EXPECT_LT(vehicle.state().pose.x_m, 16.0);
  EXPECT_FALSE(vehicle.state().wall_contact);
}

TEST(KinematicVehicle, StaysInsideTheWallsWhateverTheCommand) {
  for (int degrees = 5; degrees < 360; degrees += 30) {
    KinematicVehicle vehicle(at(0.0, 0.0, degrees * std::numbers::pi / 180.0), {}, kStep);
    bool touched = false;
    for (int i = 0; i < 30'000; ++i) {
      if (i % 5000 == 0) vehicle.set_wheel_targets(wheels(8.0, i % 10'000 == 0 ? 0.0 : 2.0));
      vehicle.step();
      touched |= vehicle.state().wall_contact;
      ASSERT_LT(beyond_walls_m(vehicle.state().pose), 1e-9) << degrees << "° after " << i << " ms";
    }
    EXPECT_TRUE(touched);
  }
}

/// The heading after 4 s against the wall at +x, met at `yaw_rad` with 4 m/s.
template <class Vehicle>
double heading_at_wall(double yaw_rad) {
  Vehicle vehicle(at(18.0, 0.0, yaw_rad), {}, kStep);
  vehicle.set_wheel_targets(wheels(4.0, 0.0));
  run(vehicle, 4.0);
  return vehicle.state().pose.yaw_rad;
}

TEST(KinematicVehicle, TurnsNoseOnOrAlongTheWallAsOdeDoes) {
  // The wall's push on a front corner, tilted by its friction (atan 0.2), passes the axle's
  // midpoint when the heading is atan(0.5/1.5) + 0.20 = 0.52 rad off the wall's normal. ODE at
  // this speed: 0.49 rad.
  for (const double yaw_rad : {0.1, 0.3, 0.4, -0.4}) {
    EXPECT_NEAR(heading_at_wall<KinematicVehicle>(yaw_rad), 0.0, 0.01) << yaw_rad;
    EXPECT_NEAR(heading_at_wall<OdeVehicle>(yaw_rad), 0.0, 0.02) << yaw_rad;
  }
  for (const double yaw_rad : {0.6, 0.8, 1.2}) {
    EXPECT_GT(heading_at_wall<KinematicVehicle>(yaw_rad), 1.2) << yaw_rad;
    EXPECT_GT(heading_at_wall<OdeVehicle>(yaw_rad), 1.2) << yaw_rad;
  }
}

// ---------------------------------------------------------------------------- the rest

TEST(KinematicVehicle, SameCommandsGiveBitIdenticalStates) {
  const auto drive = [] {
    KinematicVehicle vehicle({}, {}, kStep);
    std::vector<double> record;
    for (int i = 0; i < 40'000; ++i) {
      if (i % 700 == 0) {
        vehicle.set_wheel_targets(wheels(8.0 * std::cos(0.0004 * i), std::sin(0.001 * i)));
      }
      vehicle.step();
      const VehicleState& s = vehicle.state();
      record.insert(record.end(),
                    {s.pose.x_m, s.pose.y_m, s.pose.yaw_rad, s.twist.v_mps, s.twist.omega_radps,
                     s.left_wheel_angle_rad, s.wall_contact ? 1.0 : 0.0});
    }
    return record;
  };
  const std::vector<double> a = drive(), b = drive();
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(double)), 0);
}

TEST(KinematicVehicle, StandsUprightAtAxleHeight) {
  KinematicVehicle vehicle({}, {}, kStep);
  run(vehicle, 0.1);
  EXPECT_EQ(vehicle.state().height_m, VehicleConfig{}.wheel_radius_m);
  EXPECT_EQ(vehicle.state().roll_rad, 0.0);
  EXPECT_EQ(vehicle.state().pitch_rad, 0.0);
}

TEST(KinematicVehicle, RefusesWhatIsNotAVehicle) {
  VehicleConfig config;
  config.track_m = 0.0;
  EXPECT_THROW(KinematicVehicle(config, {}, kStep), std::invalid_argument);
  EXPECT_THROW(KinematicVehicle(at(23.0, 0.0, 0.0), {}, kStep), std::invalid_argument);
  EXPECT_THROW(KinematicVehicle({}, {}, Duration{0}), std::invalid_argument);
  KinematicVehicle vehicle({}, {}, kStep);
  EXPECT_THROW(vehicle.set_wheel_targets({std::numeric_limits<double>::quiet_NaN(), 0.0}),
               std::invalid_argument);
}

}  // namespace
}  // namespace tether
