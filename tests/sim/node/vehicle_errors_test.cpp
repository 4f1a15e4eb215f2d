#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>

#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "sim/plant/drive_errors.hpp"
#include "sim/plant/ode_world.hpp"
#include "sim/plant/plant.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/common/actuator/plan_rig.hpp"
#include "tests/support/virtual_world.hpp"

// Errors unknown to the vehicle: vehicle.radius_error, .track_error, .actuator_lag_ms,
// .clock_offset_ms and .payload_….

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::Seen;
using test::VirtualWorld;

constexpr double kErrorStep_s = 1e-3;
constexpr double kAcceleration_mps2 = 3.0;

/// Where the kinematic vehicle is after `seconds` of a twist.
Pose2 driven(const VehicleSettings& vehicle, const Twist& twist, double seconds) {
  VehicleSettings kinematic = vehicle;
  kinematic.plant = VehicleSettings::Plant::kinematic;
  kinematic.max_wheel_acceleration_mps2 = kAcceleration_mps2;
  DriveErrors errors(kinematic);
  const auto plant = make_plant(kinematic, {.half_extent_m = 1e3}, from_seconds(kErrorStep_s));
  for (int i = 0; i < std::lround(seconds / kErrorStep_s); ++i) {
    plant->set_wheel_targets(errors.step(twist, kErrorStep_s));
    plant->step();
  }
  return plant->state().pose;
}

TEST(VehicleErrors, WithoutAnyTheWheelsGetTheTwistToTheBit) {
  DriveErrors errors({});
  const WheelSpeeds rim = errors.step({1.3, -0.7}, kErrorStep_s);
  const WheelSpeeds ideal = to_wheel_speeds({1.3, -0.7}, VehicleConfig{}.track_m);
  EXPECT_EQ(rim.left_mps, ideal.left_mps);
  EXPECT_EQ(rim.right_mps, ideal.right_mps);
}

TEST(VehicleErrors, WheelsLargerByThreePercentDriveThreePercentFurther) {
  VehicleSettings larger;
  larger.radius_error = 0.03;
  // From rest to v with a: T v − v²/(2a), to half a step.
  const double a = kAcceleration_mps2;
  EXPECT_NEAR(driven({}, {1.0, 0.0}, 10.0).x_m, 10.0 - 1.0 / (2.0 * a), 1e-3);
  EXPECT_NEAR(driven(larger, {1.0, 0.0}, 10.0).x_m, 10.3 - 1.03 * 1.03 / (2.0 * a), 1e-3);
}

TEST(VehicleErrors, ATrackTakenForThreePercentTooWideTurnsThreePercentTooFar) {
  VehicleSettings vehicle;
  vehicle.track_error = 0.03;
  DriveErrors errors(vehicle);
  const Twist twist = to_twist(errors.step({1.0, 0.5}, kErrorStep_s), vehicle.track_m);
  EXPECT_NEAR(twist.v_mps, 1.0, 1e-12) << "it is as fast as it should be";
  EXPECT_NEAR(twist.omega_radps, 0.5 * 1.03, 1e-12);
  const double slowly_radps = 0.2;  // 10 s: 2 rad, from rest to 0.12 m/s at the rims in 40 ms
  EXPECT_NEAR(driven(vehicle, {0.0, slowly_radps}, 10.0).yaw_rad, 1.03 * 2.0, 0.005);
}

TEST(VehicleErrors, ALagOfFirstOrderIsAt63PercentAfterItsTimeConstant) {
  VehicleSettings vehicle;
  vehicle.actuator_lag_ms = 50.0;
  DriveErrors errors(vehicle);
  WheelSpeeds rim;
  for (int i = 0; i < 50; ++i) rim = errors.step({1.0, 0.0}, kErrorStep_s);
  EXPECT_NEAR(rim.left_mps, 1.0 - std::exp(-1.0), 0.005);  // the steps' share of it: 0.0037
  EXPECT_NEAR(rim.left_mps, 1.0 - std::pow(50.0 / 51.0, 50), 1e-12) << "backward Euler";
  EXPECT_EQ(rim.left_mps, rim.right_mps);
  for (int i = 0; i < 200; ++i) rim = errors.step({1.0, 0.0}, kErrorStep_s);
  EXPECT_NEAR(rim.left_mps, 1.0, std::exp(-5.0) + 0.005);
}

/// The centre of mass of chassis, caster and payload from the box's centre.
std::array<double, 2> centre_of_mass_m(const VehicleConfig& vehicle) {
  const OdeWorld world(vehicle, {}, kErrorStep_s);
  return {vehicle.axle_x_m - world.axle_in_chassis_m()[0], -world.axle_in_chassis_m()[1]};
}

TEST(VehicleErrors, APayloadShiftsTheCentreOfMassByItsShareOfTheMass) {
  VehicleConfig vehicle;
  const double body_kg = 1.14395 + 0.2688;
  EXPECT_NEAR(centre_of_mass_m(vehicle)[0], 0.2688 * 0.8 / body_kg, 1e-12);
  EXPECT_NEAR(centre_of_mass_m(vehicle)[1], 0.0, 1e-12);
  vehicle.payload_kg = 1.0;
  vehicle.payload_x_m = -0.2;
  vehicle.payload_y_m = 0.3;
  EXPECT_NEAR(centre_of_mass_m(vehicle)[0], (0.2688 * 0.8 - 0.2) / (body_kg + 1.0), 1e-12);
  EXPECT_NEAR(centre_of_mass_m(vehicle)[1], 0.3 / (body_kg + 1.0), 1e-12);  // 0.124 m
  vehicle.payload_kg = 0.0;
  EXPECT_NEAR(centre_of_mass_m(vehicle)[1], 0.0, 1e-12) << "nothing is there";
}

class VehicleClock : public ::testing::TestWithParam<double> {
 protected:
  VehicleClock() {
    scenario.get<VehicleSettings>().plant = VehicleSettings::Plant::kinematic;
    scenario.get<VehicleSettings>().clock_offset_ms = GetParam();
    scenario.get<ActuatorSettings>().policy = "horizon";
    scenario.get<SensorSettings>().rate_hz = 10.0;
    world.collect("AGV/POSE", poses);
    node = std::make_unique<SimNode>(scenario, world.loop, world.bus);
  }
  double speed_mps() const { return node->vehicle().state().twist.v_mps; }

  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<pose_t>> poses;
  std::unique_ptr<SimNode> node;
};

TEST_P(VehicleClock, StampsPosesWithItsOwnTime) {
  world.loop.run_until(at_s(1));
  ASSERT_EQ(poses.size(), 11U);
  for (const auto& [when, m] : poses) {
    EXPECT_EQ(m.utime, to_utime(when + from_seconds(GetParam() * 1e-3)));
  }
}

TEST_P(VehicleClock, BeginsAPlanWhenItShowsThePlansStart) {
  const Plan plan = test::plan(at_s(1.5), 0, Plan::kBasedOnNone, {0.6, 0.0}, 20);
  world.publish_at(at_s(1), "AGV/PLAN", test::to_message(plan));
  // It is ahead: the start comes earlier. In 10 ms it gains 3 m/s² · 10 ms.
  const Instant start = at_s(1.5) - from_seconds(GetParam() * 1e-3);
  world.loop.run_until(start);
  EXPECT_EQ(speed_mps(), 0.0);
  world.loop.run_until(start + std::chrono::milliseconds{20});
  EXPECT_NEAR(speed_mps(), scenario.get<VehicleSettings>().max_wheel_acceleration_mps2 * 0.02,
              0.0031);
}

INSTANTIATE_TEST_SUITE_P(AheadAndBehind, VehicleClock, ::testing::Values(20.0, -20.0, 0.0));

}  // namespace
}  // namespace tether
