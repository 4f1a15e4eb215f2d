// A loaded vehicle's acceleration with limited motor torque, against closed forms.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/vehicle/motor_torque.hpp"
#include "sim/plant/ode_vehicle.hpp"
#include "tests/sim/plant/plant_rig.hpp"

namespace tether {
namespace {

using test::kOpenFloor;
using test::kStep;
using test::kStep_s;
using test::run;

constexpr double kMaxAcceleration_mps2 = 1.0;

/// An AGV of 250 kg whose motors are too weak for the ramp of 1 m/s² with a load.
VehicleConfig agv(double payload_kg, VehicleConfig::Tyre tyre) {
  VehicleConfig v;
  v.chassis_length_m = 1.35;
  v.chassis_width_m = 0.9;
  v.chassis_height_m = 0.3;
  v.chassis_mass_kg = 235.0;
  v.chassis_z_m = 0.1;
  v.wheel_radius_m = 0.1;
  v.wheel_width_m = 0.05;
  v.wheel_mass_kg = 5.0;
  v.track_m = 0.66;
  v.axle_x_m = -0.04;
  v.caster_x_m = 0.4;
  v.caster_radius_m = 0.05;
  v.caster_mass_kg = 5.0;
  v.payload_kg = payload_kg;
  v.payload_z_m = 0.2;
  v.max_wheel_torque_Nm = 20.0;
  v.max_wheel_acceleration_mps2 = kMaxAcceleration_mps2;
  v.max_wheel_speed_mps = 3.0;
  v.tyre = tyre;
  v.anti_windup = true;
  return v;
}

double larger_torque(const VehicleState& s) {
  return std::max(std::abs(s.left_torque_Nm), std::abs(s.right_torque_Nm));
}

/// Brushes slip by F/(k N) of the rims' speed, 0.6 % where these accelerate by 1 m/s².
/// The mean acceleration from 0.5 s to 1.5 s after a start at rest; no torque beyond the limit.
double acceleration_mps2(const VehicleConfig& config, const WorldSettings& world) {
  OdeVehicle vehicle(config, world, kStep);
  run(vehicle, 1.0);
  vehicle.set_wheel_targets({3.0, 3.0});
  run(vehicle, 0.5);
  const double begin_mps = vehicle.state().twist.v_mps;
  for (int i = 0; i < 1000; ++i) {
    vehicle.step();
    EXPECT_LE(larger_torque(vehicle.state()), config.max_wheel_torque_Nm * (1.0 + 1e-6));
  }
  return vehicle.state().twist.v_mps - begin_mps;
}

constexpr VehicleConfig::Tyre kTyres[] = {VehicleConfig::Tyre::rigid, VehicleConfig::Tyre::brush};
constexpr double kLoads_kg[] = {0.0, 375.0, 750.0};

TEST(Motor, AnEmptyVehicleHasItsRampAndALoadedOneWhatTheTorqueLeaves) {
  const double expected[] = {1.0, 400.0 / 630.0, 400.0 / 1005.0};
  for (const auto tyre : kTyres) {
    for (int i = 0; i < 3; ++i) {
      const VehicleConfig config = agv(kLoads_kg[i], tyre);
      EXPECT_NEAR(std::min(kMaxAcceleration_mps2, torque_acceleration_mps2(config)), expected[i],
                  1e-12);
      EXPECT_NEAR(acceleration_mps2(config, kOpenFloor), expected[i], 0.008 * expected[i])
          << kLoads_kg[i];
    }
  }
}

TEST(Motor, ASlopeAndDragTakeTheirForceFromIt) {
  for (const auto tyre : kTyres) {
    VehicleConfig config = agv(750.0, tyre);
    WorldSettings world = kOpenFloor;
    world.slope_x = 0.02;
    config.left_drag_N = config.right_drag_N = 40.0;
    const double climb_N =
        vehicle_weight(config).mass_kg * world.gravity_mps2 * 0.02 / std::hypot(1.0, 0.02);
    const double expected = torque_acceleration_mps2(config, climb_N + 80.0);
    EXPECT_NEAR(acceleration_mps2(config, world), expected, 0.01 * expected);
  }
}

TEST(Motor, ALoadedVehicleNeedsTheWayToStopThatItsTorqueLeaves) {
  constexpr double kSpeed_mps = 1.0;
  for (const auto tyre : kTyres) {
    for (const double payload_kg : kLoads_kg) {
      const VehicleConfig config = agv(payload_kg, tyre);
      OdeVehicle vehicle(config, kOpenFloor, kStep);
      vehicle.set_wheel_targets({kSpeed_mps, kSpeed_mps});
      run(vehicle, 6.0);
      const VehicleState begin = vehicle.state();
      ASSERT_NEAR(begin.twist.v_mps, kSpeed_mps, 1e-3);
      vehicle.set_wheel_targets({});
      for (int i = 0; i < 6000; ++i) {
        vehicle.step();
        EXPECT_LE(larger_torque(vehicle.state()), config.max_wheel_torque_Nm * (1.0 + 1e-6));
      }
      const double a_mps2 = std::min(kMaxAcceleration_mps2, torque_acceleration_mps2(config));
      const double way_m = kSpeed_mps * kSpeed_mps / (2.0 * a_mps2);
      EXPECT_NEAR(vehicle.state().pose.x_m - begin.pose.x_m, way_m, 0.01 * way_m) << payload_kg;
    }
  }
}

TEST(Motor, ItsTorqueIsWhatTheMotionNeeds) {
  for (const auto tyre : kTyres) {
    const VehicleConfig config = agv(0.0, tyre);
    OdeVehicle vehicle(config, kOpenFloor, kStep);
    vehicle.set_wheel_targets({1.0, 1.0});
    run(vehicle, 0.5);
    // (m + m_w) a r/2 each, the whole vehicle and the wheels' spin.
    const double straight_Nm = 0.5 * 255.0 * kMaxAcceleration_mps2 * 0.1;
    EXPECT_NEAR(needed_torque(config, {0.5, 0.0, kMaxAcceleration_mps2}, 0.0), straight_Nm, 1e-9);
    EXPECT_NEAR(vehicle.state().left_torque_Nm, straight_Nm, 0.01 * straight_Nm);
    EXPECT_NEAR(vehicle.state().right_torque_Nm, straight_Nm, 0.01 * straight_Nm);
    run(vehicle, 2.0);  // at constant speed, none
    EXPECT_NEAR(vehicle.state().left_torque_Nm, 0.0, 0.01);
  }
}

TEST(Motor, TurningOnTheSpotTakesTheYawInertia) {
  for (const double payload_y_m : {0.0, 0.2}) {
    VehicleConfig config = agv(100.0, VehicleConfig::Tyre::rigid);
    config.payload_y_m = payload_y_m;
    config.max_wheel_torque_Nm = 60.0;
    OdeVehicle vehicle(config, kOpenFloor, kStep);
    run(vehicle, 1.0);
    vehicle.set_wheel_targets({-1.0, 1.0});
    run(vehicle, 0.1);
    const VehicleState s = vehicle.state();
    const auto [left_Nm, right_Nm] = motor_torques(config, {0.0, s.twist.omega_radps, 0.0},
                                                   2.0 * kMaxAcceleration_mps2 / config.track_m);
    EXPECT_GT(right_Nm, 10.0);
    EXPECT_NEAR(s.left_torque_Nm, left_Nm, 0.01 * right_Nm);
    EXPECT_NEAR(s.right_torque_Nm, right_Nm, 0.01 * right_Nm);
  }
}

TEST(Motor, WhatTheTyreHoldsLimitsTheTorqueOfAWheelThatSpins) {
  const VehicleConfig config = agv(0.0, VehicleConfig::Tyre::brush);
  WorldSettings ice = kOpenFloor;
  ice.friction = 0.05;
  OdeVehicle vehicle(config, ice, kStep);
  run(vehicle, 1.0);
  vehicle.set_wheel_targets({3.0, 3.0});
  run(vehicle, 1.0);
  const VehicleState s = vehicle.state();
  ASSERT_GT(s.rim_speeds.left_mps, 2.0 * s.twist.v_mps);
  // N L = m g (L − d) + m h a + m_w r a_rim with m a = μN.
  const VehicleWeight w = vehicle_weight(config);
  const double lever_m = config.caster_x_m - config.axle_x_m;
  const double spin_Nm = config.wheel_mass_kg * config.wheel_radius_m * kMaxAcceleration_mps2;
  const double wheel_N = 0.5 * (w.mass_kg * ice.gravity_mps2 * (lever_m - w.ahead_m) + spin_Nm) /
                         (lever_m - ice.friction * w.height_m);
  const double torque_Nm =
      config.wheel_radius_m *
      (ice.friction * wheel_N + 0.5 * config.wheel_mass_kg * kMaxAcceleration_mps2);
  EXPECT_LT(torque_Nm, 0.5 * config.max_wheel_torque_Nm);
  EXPECT_NEAR(s.left_torque_Nm, torque_Nm, 0.01 * torque_Nm);
}

TEST(Motor, AWheelThatLagsBehindItsRampTurnsBackAtOnce) {
  const auto left_after_reversal_mps = [](bool anti_windup) {
    VehicleConfig config = agv(750.0, VehicleConfig::Tyre::rigid);
    config.anti_windup = anti_windup;
    OdeVehicle vehicle(config, kOpenFloor, kStep);
    vehicle.set_wheel_targets({3.0, 3.0});
    run(vehicle, 2.0);
    const double before_mps = vehicle.state().twist.v_mps;
    vehicle.set_wheel_targets({});
    run(vehicle, 0.5);
    return vehicle.state().twist.v_mps - before_mps;
  };
  EXPECT_NEAR(left_after_reversal_mps(true), -0.5 * 400.0 / 1005.0, 0.005);
  EXPECT_GT(left_after_reversal_mps(false), 0.1);  // its target comes down from 2 m/s first
}

}  // namespace
}  // namespace tether
