#include <gtest/gtest.h>

#include <string>

#include "tests/can_bridge/emulated/vehicle_rig.hpp"

// A bridge that is killed at speed and started again at once, and what its drives do meanwhile.

namespace tether {
namespace {

using test::kPowerOff;
using test::kQuickStop;
using test::Vehicle;
using test::without_deadlines;

void expect_no_reset_at_speed(Vehicle& vehicle) {
  EXPECT_TRUE(vehicle.reaches(DrivePhase::standby, 12'000)) << vehicle.reason();
  EXPECT_EQ(vehicle.resets(), 2);
  EXPECT_LT(vehicle.fastest_reset_mps(), 0.03);
  EXPECT_EQ(vehicle.speed_mps(), 0.0);
}

TEST(Restart, DrivesThatQuickStopAreResetWhenTheyStand) {
  Vehicle vehicle(without_deadlines(true, kQuickStop));
  vehicle.drive(3.0);
  vehicle.kill_bridge();
  vehicle.run(400);
  ASSERT_GT(vehicle.speed_mps(), 1.0);
  vehicle.start_bridge();
  expect_no_reset_at_speed(vehicle);
}

TEST(Restart, WheelsThatCoastAreLeftAloneUntilTheyStand) {
  Vehicle vehicle(without_deadlines(false, kPowerOff));
  vehicle.drive(1.0);
  vehicle.kill_bridge();
  vehicle.run(400);
  ASSERT_GT(vehicle.speed_mps(), 0.8);
  vehicle.start_bridge();
  expect_no_reset_at_speed(vehicle);
}

TEST(Restart, WheelsThatCoastForLongAreRefusedAndNotReset) {
  Vehicle vehicle(without_deadlines(false, kPowerOff));
  vehicle.drive(3.0);
  vehicle.kill_bridge();
  vehicle.run(400);
  vehicle.start_bridge();
  ASSERT_TRUE(vehicle.reaches(DrivePhase::refused, 6000)) << vehicle.reason();
  EXPECT_NE(vehicle.reason().find("still turns at"), std::string::npos) << vehicle.reason();
  EXPECT_EQ(vehicle.resets(), 0);
  EXPECT_GT(vehicle.speed_mps(), 0.3);
  vehicle.run(3000);
  vehicle.reset_fault();
  expect_no_reset_at_speed(vehicle);
}

}  // namespace
}  // namespace tether
