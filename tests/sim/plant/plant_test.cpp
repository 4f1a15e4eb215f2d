// The plant alone, against what rolling without slip and Newton say.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <thread>
#include <vector>

#include "sim/plant/ode_vehicle.hpp"
#include "sim/plant/ode_world.hpp"
#include "tests/sim/plant/plant_rig.hpp"

namespace tether {
namespace {

using test::kOpenFloor;
using test::kStep;
using test::kStep_s;
using test::run;
using test::wheels;

/// Effect of a steady command in 60 s once the servos have reached it; the acceleration phase is
/// left out by starting to measure 5 s after the command.
struct Steady {
  double distance_m = 0.0;  ///< length of the axle midpoint's path
  double yaw_rad = 0.0;     ///< unwrapped
  Pose2 start, end;
  double left_m = 0.0;  ///< wheel angle times radius
  double right_m = 0.0;
};

Steady drive_steadily(const WheelSpeeds& targets) {
  const VehicleConfig config;
  OdeVehicle vehicle(config, kOpenFloor, kStep);
  vehicle.set_wheel_targets(targets);
  run(vehicle, 5.0);
  Steady result;
  const VehicleState first = vehicle.state();
  Pose2 last = result.start = first.pose;
  for (int i = 0; i < 60'000; ++i) {
    vehicle.step();
    const Pose2& now = vehicle.state().pose;
    result.distance_m += std::hypot(now.x_m - last.x_m, now.y_m - last.y_m);
    result.yaw_rad += wrap_angle(now.yaw_rad - last.yaw_rad);
    last = now;
  }
  const VehicleState& s = vehicle.state();
  result.end = s.pose;
  result.left_m = (s.left_wheel_angle_rad - first.left_wheel_angle_rad) * config.wheel_radius_m;
  result.right_m = (s.right_wheel_angle_rad - first.right_wheel_angle_rad) * config.wheel_radius_m;
  return result;
}

// The requirement is 1 % in distance and yaw. The plant is held to 0.1 %: its real error is the
// first-order integrator's, about ω²·step·(distance of the mass from the axle)/2, i.e. 0.02 %.
constexpr double kRelative = 1e-3;

TEST(Plant, DrivesStraightLikeRollingWithoutSlip) {
  const Steady s = drive_steadily(wheels(1.0, 0.0));
  EXPECT_NEAR(s.distance_m, 60.0, 60.0 * kRelative);
  EXPECT_NEAR(s.end.x_m - s.start.x_m, 60.0, 60.0 * kRelative);
  EXPECT_NEAR(s.end.y_m, 0.0, 1e-3);
  EXPECT_NEAR(s.yaw_rad, 0.0, 1e-4);
}

TEST(Plant, DrivesACircleLikeRollingWithoutSlip) {
  const Steady s = drive_steadily(wheels(1.0, 0.5));
  EXPECT_NEAR(s.distance_m, 60.0, 60.0 * kRelative);
  EXPECT_NEAR(s.yaw_rad, 30.0, 30.0 * kRelative);
  // The chord of the same arc of a 2 m circle; 1 % of the radius in position.
  const double a = s.start.yaw_rad;
  EXPECT_NEAR(s.end.x_m - s.start.x_m, 2.0 * (std::sin(a + 30.0) - std::sin(a)), 0.02);
  EXPECT_NEAR(s.end.y_m - s.start.y_m, 2.0 * (std::cos(a) - std::cos(a + 30.0)), 0.02);
}

TEST(Plant, SpinsLikeRollingWithoutSlip) {
  const Steady s = drive_steadily({-1.0, 1.0});
  EXPECT_NEAR(s.yaw_rad, 100.0, 100.0 * kRelative);
  // The axle's midpoint stays: it may wander by 1 % of the 60 m that each rim rolls.
  EXPECT_LT(std::hypot(s.end.x_m - s.start.x_m, s.end.y_m - s.start.y_m), 0.01);
  EXPECT_LT(s.distance_m, 0.6);
}

TEST(Plant, WheelAngleTimesRadiusIsTheDistanceRolled) {
  const Steady s = drive_steadily(wheels(1.0, 0.5));
  EXPECT_NEAR((s.left_m + s.right_m) / 2.0, s.distance_m, 60.0 * kRelative);
  EXPECT_NEAR((s.right_m - s.left_m) / VehicleConfig{}.track_m, s.yaw_rad, 30.0 * kRelative);
}

TEST(Plant, RestsAtAxleHeightWithoutDriftOrGainOfEnergy) {
  OdeVehicle vehicle({}, {}, kStep);
  run(vehicle, 1.0);  // settle
  const VehicleState settled = vehicle.state();
  EXPECT_NEAR(settled.height_m, VehicleConfig{}.wheel_radius_m, 0.5e-3);  // the contact layer
  EXPECT_NEAR(settled.pitch_rad, 0.0, 1e-3);
  double fastest_mps = 0.0;
  for (int i = 0; i < 20'000; ++i) {
    const double height_m = vehicle.state().height_m;
    vehicle.step();
    const VehicleState& s = vehicle.state();
    fastest_mps = std::max({fastest_mps, std::abs(s.twist.v_mps), std::abs(s.twist.omega_radps),
                            std::abs(s.height_m - height_m) / kStep_s});
  }
  const VehicleState& s = vehicle.state();
  EXPECT_LT(fastest_mps, 1e-6);
  EXPECT_LT(std::hypot(s.pose.x_m - settled.pose.x_m, s.pose.y_m - settled.pose.y_m), 1e-6);
  EXPECT_NEAR(s.pose.yaw_rad, settled.pose.yaw_rad, 1e-6);
  EXPECT_NEAR(s.height_m, settled.height_m, 1e-6);
  EXPECT_NEAR(s.pitch_rad, settled.pitch_rad, 1e-6);
  EXPECT_EQ(vehicle.solver_complaints(), 0u);
}

TEST(Plant, BrakesToRestWithinTheAccelerationLimitsDistance) {
  OdeVehicle vehicle({}, kOpenFloor, kStep);
  vehicle.set_wheel_targets(wheels(6.0, 0.0));
  run(vehicle, 5.0);
  const double x_m = vehicle.state().pose.x_m;
  vehicle.set_wheel_targets({});
  run(vehicle, 3.0);
  EXPECT_NEAR(vehicle.state().pose.x_m - x_m, 6.0 * 6.0 / (2.0 * 3.0), 0.01);  // v²/2a
  EXPECT_NEAR(vehicle.state().twist.v_mps, 0.0, 1e-6);
}

TEST(Plant, RimSpeedsNeverChangeFasterThanTheAccelerationLimit) {
  const VehicleConfig config;
  OdeVehicle vehicle(config, kOpenFloor, kStep);
  const double limit_mps = config.max_wheel_acceleration_mps2 * kStep_s;
  for (const double v_mps : {8.0, -8.0, 3.0}) {
    vehicle.set_wheel_targets(wheels(v_mps, 0.1));  // gentle enough not to skid
    for (int i = 0; i < 6000; ++i) {
      const WheelSpeeds before = vehicle.state().rim_speeds;
      vehicle.step();
      const WheelSpeeds& after = vehicle.state().rim_speeds;
      // The servo holds its target up to the solver's softness.
      ASSERT_LT(std::abs(after.left_mps - before.left_mps), limit_mps + 1e-6);
      ASSERT_LT(std::abs(after.right_mps - before.right_mps), limit_mps + 1e-6);
    }
    EXPECT_NEAR(vehicle.state().twist.v_mps, v_mps, 0.01);
  }
}

TEST(Plant, ServosPullNoHarderThanTheirTorqueLimit) {
  VehicleConfig config;
  config.max_wheel_torque_Nm = 0.5;
  config.max_wheel_acceleration_mps2 = 1000.0;
  OdeVehicle vehicle(config, kOpenFloor, kStep);
  vehicle.set_wheel_targets(wheels(8.0, 0.0));
  run(vehicle, 4.0);
  // Newton: two rim forces accelerate all masses and, as cylinders, both wheels' rotation (I/r²).
  const double mass_kg =
      config.chassis_mass_kg + config.caster_mass_kg + 2.0 * config.wheel_mass_kg;
  const double expected_mps2 = 2.0 * config.max_wheel_torque_Nm / config.wheel_radius_m /
                               (mass_kg + 2.0 * 0.5 * config.wheel_mass_kg);
  EXPECT_NEAR(vehicle.state().twist.v_mps, 4.0 * expected_mps2, 0.01 * 4.0 * expected_mps2);
}

TEST(Plant, ScalesBothWheelsTogetherAtTheSpeedLimit) {
  OdeVehicle vehicle({}, kOpenFloor, kStep);
  vehicle.set_wheel_targets({30.0, 27.0});
  run(vehicle, 5.0);
  EXPECT_NEAR(vehicle.state().rim_speeds.left_mps, 10.0, 1e-3);
  EXPECT_NEAR(vehicle.state().rim_speeds.right_mps, 9.0, 1e-3);
}

/// Drives for `seconds`, a new command every second, and returns the largest |roll| or |pitch|.
template <typename NextCommand>
double largest_tilt_rad(OdeVehicle& vehicle, int seconds, NextCommand next_command) {
  double tilt_rad = 0.0;
  for (int second = 0; second < seconds; ++second) {
    const Twist command = next_command(second);
    vehicle.set_wheel_targets(wheels(command.v_mps, command.omega_radps));
    for (int i = 0; i < 1000; ++i) {
      vehicle.step();
      const VehicleState& s = vehicle.state();
      tilt_rad = std::max({tilt_rad, std::abs(s.roll_rad), std::abs(s.pitch_rad)});
    }
  }
  return tilt_rad;
}

// Upright means all three supports on the floor: 0.005 rad is 6 mm of lift at one wheel.
constexpr double kUpright_rad = 0.005;

TEST(Plant, StaysUprightInStraightCommandReversals) {
  OdeVehicle vehicle({}, kOpenFloor, kStep);
  EXPECT_LT(largest_tilt_rad(vehicle, 40,
                             [](int t) {
                               return Twist{(t / 4) % 2 ? -8.0 : 8.0, 0.0};
                             }),
            kUpright_rad);
}

TEST(Plant, StaysUprightInTheControllersWorstCommandSteps) {
  constexpr std::array<Twist, 8> kSteps{
      {{8, 2}, {-8, -2}, {8, -2}, {-8, 2}, {0, 2}, {8, 0}, {0, -2}, {-8, 0}}};
  OdeVehicle vehicle({}, kOpenFloor, kStep);
  EXPECT_LT(largest_tilt_rad(vehicle, 64, [&](int t) { return kSteps[t % 8]; }), kUpright_rad);
  // Held for longer, 8 m/s at 2 rad/s asks for 16 m/s² sideways: it skids, and leans doing so. It
  // would tip over at 0.8 rad.
  constexpr double kSkidding_rad = 0.1;
  EXPECT_LT(largest_tilt_rad(vehicle, 64, [&](int t) { return kSteps[(t / 4) % 8]; }),
            kSkidding_rad);
  std::mt19937 random(1);
  const auto uniform = [&] { return static_cast<double>(random()) / random.max() * 2.0 - 1.0; };
  EXPECT_LT(largest_tilt_rad(vehicle, 120,
                             [&](int) {
                               return Twist{8 * uniform(), 2 * uniform()};
                             }),
            kSkidding_rad);
}

/// How far the vehicle's footprint reaches beyond the walls; negative: it is inside.
double beyond_walls_m(const Pose2& pose, double half_extent_m) {
  double farthest_m = 0.0;
  // The box's corners and the wheels', from the axle's midpoint; left and right.
  for (const auto& [x, y] : {std::pair{1.5, 0.5}, {-0.5, 0.5}, {0.4, 0.7}, {-0.4, 0.7}}) {
    for (const double side : {-1.0, 1.0}) {
      const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
      farthest_m = std::max({farthest_m, std::abs(pose.x_m + c * x - s * side * y),
                             std::abs(pose.y_m + s * x + c * side * y)});
    }
  }
  return farthest_m - half_extent_m;
}

TEST(Plant, AWallStopsItNoseOnAndBothWheelsSlip) {
  for (const double v_mps : {1.0, 4.0, 8.0}) {
    VehicleConfig config;
    config.start_x_m = 10.0;
    OdeVehicle vehicle(config, {}, kStep);
    vehicle.set_wheel_targets(wheels(v_mps, 0.0));
    ::testing::internal::CaptureStderr();
    run(vehicle, 30.0);
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");  // the solver's complaints are counted
    const VehicleState& s = vehicle.state();
    EXPECT_TRUE(s.wall_contact);
    EXPECT_NEAR(s.pose.x_m, 22.0 - 1.5, 2e-3);  // nose to axle: 1.5 m
    EXPECT_NEAR(s.twist.v_mps, 0.0, 0.01);
    EXPECT_NEAR(s.pose.yaw_rad, 0.0, 0.02);
    EXPECT_NEAR(s.rim_speeds.left_mps, v_mps, 0.01);
    EXPECT_NEAR(s.rim_speeds.right_mps, v_mps, 0.01);
  }
}

TEST(Plant, StaysInsideTheWallsAtAnyAngle) {
  for (int degrees = 5; degrees < 360; degrees += 30) {
    for (const double v_mps : {2.0, 8.0}) {
      VehicleConfig config;
      config.start_yaw_rad = degrees * std::numbers::pi / 180.0;
      OdeVehicle vehicle(config, {}, kStep);
      vehicle.set_wheel_targets(wheels(v_mps, 0.0));
      bool touched = false;
      for (int i = 0; i < 20'000; ++i) {
        vehicle.step();
        touched |= vehicle.state().wall_contact;
        // At 8 m/s it moves 8 mm in the step in which it meets the wall.
        ASSERT_LT(beyond_walls_m(vehicle.state().pose, 22.0), 0.02) << degrees << "° " << v_mps;
      }
      EXPECT_TRUE(touched);
      EXPECT_LT(std::abs(vehicle.state().roll_rad), 0.1) << degrees << "° " << v_mps;
    }
  }
}

TEST(Plant, LeavesAWallBackwards) {
  VehicleConfig config;
  config.start_x_m = 18.0;
  OdeVehicle vehicle(config, {}, kStep);
  vehicle.set_wheel_targets(wheels(4.0, 0.0));
  run(vehicle, 5.0);
  vehicle.set_wheel_targets(wheels(-1.0, 0.0));
  run(vehicle, 8.0);
  EXPECT_LT(vehicle.state().pose.x_m, 16.0);
  EXPECT_FALSE(vehicle.state().wall_contact);
}

/// A drive that turns, brakes, reverses and ends at a wall; every number of every 10th state.
std::vector<double> varied_drive(double mirror = 1.0, double speed_mps = 5.0) {
  OdeVehicle vehicle({}, {}, kStep);
  std::vector<double> record;
  for (int i = 0; i < 20'000; ++i) {
    if (i % 500 == 0) {
      const double t_s = i * kStep_s;
      vehicle.set_wheel_targets(wheels(speed_mps * std::cos(0.4 * t_s), mirror * std::sin(t_s)));
    }
    vehicle.step();
    if (i % 10 != 9) continue;
    const VehicleState& s = vehicle.state();
    record.insert(record.end(), {s.pose.x_m, s.pose.y_m, s.pose.yaw_rad, s.twist.v_mps,
                                 s.twist.omega_radps, s.rim_speeds.left_mps, s.rim_speeds.right_mps,
                                 s.left_wheel_angle_rad, s.right_wheel_angle_rad, s.height_m,
                                 s.roll_rad, s.pitch_rad, s.wall_contact ? 1.0 : 0.0});
  }
  return record;
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

TEST(Plant, SameCommandsGiveBitIdenticalStatesInAnyThread) {
  const std::vector<double> reference = varied_drive(1.0, 8.0);
  ASSERT_TRUE(
      std::all_of(reference.begin(), reference.end(), [](double x) { return std::isfinite(x); }));
  EXPECT_TRUE(same_bits(reference, varied_drive(1.0, 8.0)));
  std::array<std::vector<double>, 4> results;
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < results.size(); ++k) {
    threads.emplace_back([&results, k] {
      for (std::size_t i = 0; i < k; ++i) varied_drive(-1.0, 3.0);  // other vehicles first
      results[k] = varied_drive(1.0, 8.0);
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_TRUE(same_bits(reference, result));
}

TEST(Plant, IsTheSameLeftAsRight) {
  const std::vector<double> left = varied_drive(1.0, 1.5);
  const std::vector<double> right = varied_drive(-1.0, 1.5);
  // The solver takes the wheels in a fixed order, so that mirrored runs agree to rounding only.
  constexpr double kTolerance = 1e-6;
  for (std::size_t i = 0; i < left.size(); i += 13) {
    ASSERT_NEAR(left[i], right[i], kTolerance);
    ASSERT_NEAR(left[i + 1], -right[i + 1], kTolerance);
    ASSERT_NEAR(wrap_angle(left[i + 2] + right[i + 2]), 0.0, kTolerance);
    ASSERT_NEAR(left[i + 5], right[i + 6], kTolerance);
  }
}

TEST(Plant, SolvingWithoutInactiveLimitsChangesNothing) {
  const VehicleConfig config;
  OdeWorld fast(config, kOpenFloor, kStep_s);
  OdeWorld reference(config, kOpenFloor, kStep_s);
  reference.set_always_limited(true);
  WheelSpeeds targets;
  for (int i = 0; i < 60'000; ++i) {
    // Up to 3 m/s, 0.6 rad/s and 2 m/s²: neither slip nor saturation.
    const double t_s = i * kStep_s;
    targets = wheels(2.0 * std::sin(0.3 * t_s) + std::sin(0.9 * t_s), 0.6 * std::sin(0.7 * t_s));
    fast.step(targets);
    reference.step(targets);
    const dReal* a = dBodyGetPosition(fast.chassis());
    const dReal* b = dBodyGetPosition(reference.chassis());
    ASSERT_LT(std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]), 1e-5) << "after " << t_s << " s";
  }
  EXPECT_LT(fast.limited_steps(), 600u);  // else this test compares nothing
  EXPECT_EQ(reference.limited_steps(), 60'000u);
}

TEST(Plant, LimitsAreAppliedInTheVeryStepThatNeedsThem) {
  VehicleConfig config;
  config.max_wheel_torque_Nm = 0.2;
  OdeWorld fast(config, kOpenFloor, kStep_s);
  OdeWorld reference(config, kOpenFloor, kStep_s);
  reference.set_always_limited(true);
  for (int i = 0; i < 200; ++i) fast.step({}), reference.step({});
  for (int i = 0; i < 50; ++i) {
    fast.step({1.0, 1.0});
    reference.step({1.0, 1.0});
    ASSERT_NEAR(fast.rim_speeds().left_mps, reference.rim_speeds().left_mps, 1e-6);
  }
  EXPECT_EQ(fast.repeated_steps(), 1u);
}

TEST(Plant, RefusesWhatIsNotAVehicle) {
  VehicleConfig config;
  config.wheel_radius_m = 0.0;
  EXPECT_THROW(OdeVehicle(config, {}, kStep), std::invalid_argument);
  config = {};
  config.start_x_m = 23.0;
  EXPECT_THROW(OdeVehicle(config, {}, kStep), std::invalid_argument);
  EXPECT_THROW(OdeVehicle({}, {}, Duration{0}), std::invalid_argument);
  OdeVehicle vehicle({}, {}, kStep);
  EXPECT_THROW(vehicle.set_wheel_targets({std::numeric_limits<double>::quiet_NaN(), 0.0}),
               std::invalid_argument);
}

}  // namespace
}  // namespace tether
