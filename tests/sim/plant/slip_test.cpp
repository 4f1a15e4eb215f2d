// The ODE plant with tyres that slip, against closed forms.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/vehicle/grip.hpp"
#include "sim/plant/ode_vehicle.hpp"
#include "sim/plant/ode_world.hpp"
#include "tests/sim/plant/plant_rig.hpp"

namespace tether {
namespace {

using test::kOpenFloor;
using test::kStep;
using test::kStep_s;
using test::run;

constexpr double kGravity = 9.81;

VehicleConfig toy(VehicleConfig::Tyre tyre = VehicleConfig::Tyre::brush) {
  VehicleConfig config;
  config.tyre = tyre;
  return config;
}

/// 1000 kg on tyres of 0.1 m.
VehicleConfig heavy() {
  VehicleConfig v;
  v.chassis_length_m = 1.35;
  v.chassis_width_m = 0.9;
  v.chassis_height_m = 0.3;
  v.chassis_mass_kg = 250.0;
  v.chassis_z_m = 0.1;
  v.wheel_radius_m = 0.1;
  v.wheel_width_m = 0.05;
  v.wheel_mass_kg = 5.0;
  v.track_m = 0.66;
  v.axle_x_m = -0.1;
  v.caster_x_m = 0.35;
  v.caster_radius_m = 0.05;
  v.caster_mass_kg = 5.0;
  v.payload_kg = 735.0;
  v.payload_z_m = 0.2;
  v.max_wheel_torque_Nm = 60.0;
  v.max_wheel_acceleration_mps2 = 1.0;
  v.max_wheel_speed_mps = 3.0;
  v.tyre = VehicleConfig::Tyre::brush;
  return v;
}

WorldSettings floor_of(double friction) {
  WorldSettings world = kOpenFloor;
  world.friction = friction;
  return world;
}

/// Wheels that follow their setpoints at once.
VehicleConfig unlimited(VehicleConfig v) {
  v.max_wheel_torque_Nm = 1e5;
  v.max_wheel_acceleration_mps2 = 1e5;
  v.max_wheel_speed_mps = 100.0;
  return v;
}

/// Brings it up to `v_mps` straight ahead without slip, at 1 m/s².
void speed_up(OdeVehicle& vehicle, double v_mps) {
  const int steps = static_cast<int>(v_mps / kStep_s);
  for (int i = 1; i <= steps; ++i) {
    vehicle.set_wheel_targets({v_mps * i / steps, v_mps * i / steps});
    vehicle.step();
  }
  run(vehicle, 1.0);
}

/// m a = μ N with N L = m g (L − d) + (m h + m_w r) a, the second term if the wheels speed up with
/// the vehicle.
double full_traction_mps2(const VehicleConfig& config, double friction, bool spins_up) {
  const VehicleWeight w = vehicle_weight(config);
  const double spin_m = spins_up ? config.wheel_mass_kg * config.wheel_radius_m / w.mass_kg : 0.0;
  return friction * kGravity * axle_load_share(config) /
         (1.0 - friction * (w.height_m + spin_m) / (config.caster_x_m - config.axle_x_m));
}

TEST(Slip, SpinningWheelsPushWithTheFrictionOfTheAxlesLoad) {
  constexpr double kFriction = 0.25;  // with 0.3 the heavy one lifts its nose
  for (const VehicleConfig& config : {unlimited(toy()), unlimited(heavy())}) {
    OdeVehicle vehicle(config, floor_of(kFriction), kStep);
    run(vehicle, 0.5);
    for (int i = 0; i < 3000; ++i) {  // gently: the wheels' own inertia would lift the nose
      vehicle.set_wheel_targets({4.0 * i * kStep_s, 4.0 * i * kStep_s});
      vehicle.step();
    }
    const double begin_mps = vehicle.state().twist.v_mps;
    run(vehicle, 0.5);
    ASSERT_GT(vehicle.state().rim_speeds.left_mps, 1.2 * vehicle.state().twist.v_mps);
    const double a_mps2 = (vehicle.state().twist.v_mps - begin_mps) / 0.5;
    const double expected = full_traction_mps2(config, kFriction, false);
    EXPECT_NEAR(a_mps2, expected, 0.005 * expected);
  }
}

TEST(Slip, TyresHoldUpToTheFrictionOfTheAxlesLoad) {
  constexpr double kFriction = 0.25;
  for (const VehicleConfig& config : {toy(), heavy()}) {
    VehicleConfig v = unlimited(config);
    v.tyre_stiffness = 200.0;
    for (const double share : {0.9, 1.1}) {
      const double a_mps2 = share * full_traction_mps2(v, kFriction, true);
      EXPECT_NEAR(needed_friction(v, kGravity, {1.0, 0.0, a_mps2 / share}), kFriction, 1e-9);
      OdeVehicle vehicle(v, floor_of(kFriction), kStep);
      run(vehicle, 0.5);
      for (int i = 0; i < 2000; ++i) {
        vehicle.set_wheel_targets({a_mps2 * i * kStep_s, a_mps2 * i * kStep_s});
        vehicle.step();
      }
      const VehicleState s = vehicle.state();
      const double slip = s.rim_speeds.left_mps / s.twist.v_mps - 1.0;
      const double sliding = 3.0 * kFriction / v.tyre_stiffness;
      EXPECT_EQ(slip > sliding, share > 1.0) << share << ": " << slip;
    }
  }
}

TEST(Slip, LockedWheelsBrakeInTheDistanceOfTheAxlesFriction) {
  constexpr double kFriction = 0.3;
  for (const VehicleConfig& config : {unlimited(toy()), unlimited(heavy())}) {
    OdeVehicle vehicle(config, floor_of(kFriction), kStep);
    speed_up(vehicle, 4.0);
    for (int i = 0; i <= 500; ++i) {  // locks them
      vehicle.set_wheel_targets({4.0 - 8.0 * i * kStep_s, 4.0 - 8.0 * i * kStep_s});
      vehicle.step();
    }
    const VehicleState begin = vehicle.state();
    run(vehicle, 4.0);
    const VehicleState end = vehicle.state();
    const double lever_m = config.caster_x_m - config.axle_x_m;
    const double a_mps2 = kFriction * kGravity * axle_load_share(config) /
                          (1.0 + kFriction * vehicle_weight(config).height_m / lever_m);
    const double expected_m = begin.twist.v_mps * begin.twist.v_mps / (2.0 * a_mps2);
    EXPECT_NEAR(end.pose.x_m - begin.pose.x_m, expected_m, 0.01 * expected_m);
    EXPECT_NEAR(end.twist.v_mps, 0.0, 1e-6);
  }
}

/// A circle that is driven for a while.
struct Circle {
  double lateral_mps2 = 0.0;  ///< v ω, as driven
  double omega_radps = 0.0;
  double sideways = 0.0;  ///< slip angle of the axle
};

Circle drive_circle(const VehicleConfig& config, double friction, const Twist& told) {
  OdeVehicle vehicle(config, floor_of(friction), kStep);
  speed_up(vehicle, told.v_mps);
  for (int i = 0; i < 2000; ++i) {
    const double share = i / 2000.0;
    vehicle.set_wheel_targets(
        to_wheel_speeds({told.v_mps, told.omega_radps * share}, config.track_m));
    vehicle.step();
  }
  run(vehicle, 3.0);
  constexpr int kSteps = 1000;
  Circle mean;
  for (int i = 0; i < kSteps; ++i) {
    const Pose2 before = vehicle.state().pose;
    vehicle.step();
    const VehicleState s = vehicle.state();
    const double heading = before.yaw_rad + 0.5 * s.twist.omega_radps * kStep_s;
    const double sideways_mps = (std::cos(heading) * (s.pose.y_m - before.y_m) -
                                 std::sin(heading) * (s.pose.x_m - before.x_m)) /
                                kStep_s;
    mean.lateral_mps2 += s.twist.v_mps * s.twist.omega_radps / kSteps;
    mean.omega_radps += s.twist.omega_radps / kSteps;
    mean.sideways += std::abs(sideways_mps) / s.twist.v_mps / kSteps;
  }
  return mean;
}

/// The circle from which on the axle's slip angle is more than `slip`, faster and faster at one
/// commanded yaw rate.
Circle find_onset(const VehicleConfig& config, double friction, double omega_radps, double slip) {
  double low = 0.7 * friction * kGravity / 2.0, high = 1.2 * friction * kGravity;
  Circle at_low;
  for (int i = 0; i < 6; ++i) {
    const double middle = 0.5 * (low + high);
    const Circle c = drive_circle(config, friction, {middle / omega_radps, omega_radps});
    (c.sideways > slip ? high : low) = middle;
    if (c.sideways <= slip) at_low = c;
  }
  return at_low;
}

TEST(Slip, TheFloorPressesTheTyresAsTheBalancesSay) {
  for (VehicleConfig config : {unlimited(toy()), unlimited(heavy())}) {
    config.tyre_stiffness = 1000.0;  // next to no slip
    config.payload_kg += 0.3;
    config.payload_y_m = 0.1;
    for (const double omega : {2.0, -1.0}) {
      OdeWorld world(config, kOpenFloor, kStep_s);
      for (int i = 0; i < 4000; ++i) {
        const double share = std::min(1.0, i / 2000.0);
        world.step(to_wheel_speeds({1.6 * share, omega * share}, config.track_m));
      }
      const TyreLoads expected = tyre_loads(config, kGravity, {1.6, omega, 0.0});
      for (const int side : {0, 1}) {
        EXPECT_NEAR(world.pressing()[side], expected.pressing_N[side],
                    0.005 * expected.pressing_N[side])
            << omega;
      }
    }
  }
}

TEST(Slip, RigidTyresLetGoAtTheFrictionOfTheAxlesLoad) {
  const VehicleConfig config = unlimited(toy(VehicleConfig::Tyre::rigid));
  EXPECT_NEAR(axle_load_share(config), 0.7923, 1e-4);
  EXPECT_NEAR(lateral_grip_mps2(config, 0.6, kGravity, 0.0), 4.664, 1e-3);
  for (const double omega : {1.0, 2.0}) {
    const Circle c = find_onset(config, 0.6, omega, 0.002);
    const double expected = lateral_grip_mps2(config, 0.6, kGravity, c.omega_radps);
    EXPECT_NEAR(c.lateral_mps2, expected, 0.015 * expected) << omega;
  }
}

TEST(Slip, BrushTyresLetGoWhereTheirCirclesDo) {
  for (VehicleConfig config : {unlimited(toy()), unlimited(heavy())}) {
    config.tyre_stiffness = 400.0;  // so that there is an edge
    for (const double omega : {0.7, 1.5}) {
      const double sliding = 3.0 * 0.6 / config.tyre_stiffness;
      const Circle c = find_onset(config, 0.6, omega, sliding);
      const double expected = lateral_grip_mps2(config, 0.6, kGravity, c.omega_radps);
      EXPECT_NEAR(c.lateral_mps2, expected, 0.025 * expected) << omega;
    }
  }
}

TEST(Slip, ATurnIsWiderByTheSlipThatItsForcesNeed) {
  for (VehicleConfig config : {toy(), heavy()}) {
    config.tyre_stiffness = 5.0;  // so that slip is more than the integrator's error
    for (const double omega : {0.2, 0.4}) {
      const Twist told{1.0, omega};
      const Circle c = drive_circle(config, 0.6, told);
      // Each rim loses F/(k N) of its speed, as long as slip is small.
      const TyreLoads t = tyre_loads(config, kGravity, {1.0, omega, 0.0});
      const WheelSpeeds rim = to_wheel_speeds(told, config.track_m);
      const auto slip = [&](int side) {
        return t.along_N[side] / (config.tyre_stiffness * t.pressing_N[side]);
      };
      const double slower = (rim.right_mps * slip(1) - rim.left_mps * slip(0)) / config.track_m;
      EXPECT_GT(slower, 0.0);
      EXPECT_NEAR(omega - c.omega_radps, slower, 0.1 * slower) << omega;
      // Across, both tyres slip with one velocity.
      double hold_Nspm = 0.0;
      for (const int side : {0, 1}) {
        const double rolling_mps = side == 0 ? rim.left_mps : rim.right_mps;
        hold_Nspm += config.tyre_stiffness * t.pressing_N[side] / rolling_mps;
      }
      const double across = t.across_N / hold_Nspm / told.v_mps;
      EXPECT_NEAR(c.sideways, across, 0.1 * across) << omega;
    }
  }
}

TEST(Slip, TheServosWorkIsMotionAndSlip) {
  for (VehicleConfig config : {toy(), heavy()}) {
    config.max_wheel_acceleration_mps2 = 1e5;
    config.max_wheel_torque_Nm *= 0.5;  // and the servos always pull with it
    OdeVehicle vehicle(config, kOpenFloor, kStep);
    run(vehicle, 1.0);
    vehicle.set_wheel_targets({3.0, 3.0});
    const double mass_kg = vehicle_weight(config).mass_kg;
    double slip_J = 0.0;
    const double begin_rad = vehicle.state().left_wheel_angle_rad;
    VehicleState s = vehicle.state();
    while (s.rim_speeds.left_mps < 1.5) {
      const double before_mps = s.twist.v_mps;
      vehicle.step();
      s = vehicle.state();
      slip_J += mass_kg * (s.twist.v_mps - before_mps) * (s.rim_speeds.left_mps - s.twist.v_mps);
    }
    const double work_J = 2.0 * config.max_wheel_torque_Nm * (s.left_wheel_angle_rad - begin_rad);
    const double spin_J =  // two cylinders
        2.0 * 0.25 * config.wheel_mass_kg * s.rim_speeds.left_mps * s.rim_speeds.left_mps;
    const double motion_J = 0.5 * mass_kg * s.twist.v_mps * s.twist.v_mps;
    EXPECT_GT(slip_J, 0.003 * work_J);
    EXPECT_NEAR(motion_J + spin_J + slip_J, work_J, 0.002 * work_J);
  }
}

TEST(Slip, AtRestNothingCreepsOrRings) {
  for (const VehicleConfig& config : {toy(), heavy()}) {
    OdeVehicle vehicle(config, kOpenFloor, kStep);
    vehicle.set_wheel_targets({1.0, 0.5});
    run(vehicle, 3.0);
    vehicle.set_wheel_targets({});
    run(vehicle, 4.0);
    const VehicleState begin = vehicle.state();
    EXPECT_NEAR(begin.twist.v_mps, 0.0, 1e-6);
    run(vehicle, 10.0);
    const VehicleState end = vehicle.state();
    EXPECT_NEAR(end.pose.x_m, begin.pose.x_m, 1e-5);
    EXPECT_NEAR(end.pose.yaw_rad, begin.pose.yaw_rad, 1e-6);
    EXPECT_EQ(vehicle.solver_complaints(), 0u);
  }
}

/// Where a varied drive of 10 s with slip ends.
Pose2 end_of_drive(const VehicleConfig& config, Duration step) {
  OdeVehicle vehicle(config, kOpenFloor, step);
  for (Duration t{0}; t < std::chrono::seconds{10}; t += step) {
    // A new command every 10 ms, which all steps share.
    if (t % std::chrono::milliseconds{10} == Duration{0}) {
      const double s = to_seconds(t);
      vehicle.set_wheel_targets(to_wheel_speeds(
          {1.2 + 0.5 * std::sin(1.3 * s), 0.8 * std::sin(0.7 * s)}, config.track_m));
    }
    vehicle.step();
  }
  return vehicle.state().pose;
}

TEST(Slip, SmallerStepsConverge) {
  for (const VehicleConfig& config : {toy(), heavy()}) {
    const Pose2 fine = end_of_drive(config, std::chrono::microseconds{125});
    double last_m = 1.0;
    for (const int us : {2000, 1000, 500}) {
      const Pose2 end = end_of_drive(config, std::chrono::microseconds{us});
      const double off_m = std::hypot(end.x_m - fine.x_m, end.y_m - fine.y_m);
      EXPECT_LT(off_m, 0.65 * last_m) << us;  // first order: half of it
      last_m = off_m;
    }
    EXPECT_LT(last_m, 0.01);
  }
}

}  // namespace
}  // namespace tether
