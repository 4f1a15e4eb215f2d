#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/emulated/vehicle_rig.hpp"
#include "tests/support/source_dir.hpp"

// Drives that acknowledge a stop and brake too weakly, or not at all.

namespace tether {
namespace {

using test::Vehicle;
using ::testing::HasSubstr;

Cia402Config drivetrain_of(std::int64_t quick_stop_ramp) {
  auto config =
      std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/two_node_cia402.toml")));
  for (SetupWrite& setup : config.setup) {
    if (setup.object.index == 0x6085) setup.value = quick_stop_ramp;
  }
  return config;
}

TEST(Braking, AQuickStopThatBrakesHasNoSecondMeasure) {
  Vehicle vehicle(drivetrain_of(19200));
  vehicle.drive(1.0);
  vehicle.bridge().stop(StopKind::quick);
  EXPECT_TRUE(vehicle.reaches(DrivePhase::standby, 600)) << vehicle.reason();
  EXPECT_EQ(vehicle.bridge().counters().brake_escalations, 0);
}

TEST(Braking, AQuickStopThatDoesNotBrakeIsReplacedByATargetOfZeroAfter150Ms) {
  // 192 instead of 19200: 0.04 m/s².
  auto config = drivetrain_of(192);
  for (SetupWrite& setup : config.setup) {
    if (setup.object.index == 0x605A) setup.value = 6;
  }
  Vehicle vehicle(config);
  vehicle.drive(1.0);
  const double from_m = vehicle.way_m();
  vehicle.bridge().stop(StopKind::quick);
  vehicle.run(140);
  EXPECT_EQ(vehicle.bridge().counters().brake_escalations, 0);
  vehicle.run(60);
  EXPECT_EQ(vehicle.bridge().counters().brake_escalations, 2) << "one of each wheel";
  EXPECT_EQ(vehicle.phase(), DrivePhase::faulted);
  EXPECT_THAT(vehicle.reason(), HasSubstr("left drive (node 1): does not brake"));
  EXPECT_THAT(vehicle.reason(), HasSubstr("is braked by a target of zero"));
  const int stands_ms = 200 + vehicle.time_to_standstill_ms();
  fmt::print("measured: quick stop of 0.04 m/s2 at 1 m/s: stands after {} ms, {:.2f} m\n",
             stands_ms, vehicle.way_m() - from_m);
  EXPECT_LE(stands_ms, 500);
  vehicle.run(300);
  EXPECT_FALSE(vehicle.bridge().snapshot(vehicle.now()).in_doubt) << "its power is off";
}

TEST(Braking, AQuickStopThatTheDriveDoesNotLeaveIsFollowedByItsOwnWatchdog) {
  Vehicle vehicle(drivetrain_of(192));  // 0x605A = 2: no way back to OperationEnabled
  vehicle.drive(1.0);
  const double from_m = vehicle.way_m();
  vehicle.bridge().stop(StopKind::quick);
  vehicle.run(400);
  EXPECT_EQ(vehicle.bridge().counters().brake_escalations, 4);
  EXPECT_THAT(vehicle.reason(), HasSubstr("heartbeat and setpoints are withheld"));
  EXPECT_EQ(vehicle.heartbeats(300), 0);
  EXPECT_EQ(vehicle.setpoints(), 0);
  // The watchdog's reaction has the same ramp here: nothing is left, and the reason says so.
  vehicle.run(400);
  EXPECT_THAT(vehicle.reason(), HasSubstr("use the hard-wired emergency stop"));
  fmt::print("measured: nothing brakes: {:.2f} m/s after 1.1 s, {:.2f} m\n", vehicle.speed_mps(),
             vehicle.way_m() - from_m);
  EXPECT_EQ(vehicle.resets(), 0);
}

TEST(Braking, AWheelThatCoastsWithoutPowerIsNamedAndTheOtherDriveKeepsItsHeartbeat) {
  auto config = drivetrain_of(19200);
  config.emulated_brake = false;
  for (SetupWrite& setup : config.setup) {
    if (setup.object.index == 0x605E) setup.value = 0;
  }
  Vehicle vehicle(config);
  vehicle.drive(1.0);
  vehicle.drives().inject({.node = 2, .kind = DriveFault::Kind::fault}, vehicle.now());
  EXPECT_GT(vehicle.heartbeats(600), 5);
  EXPECT_EQ(vehicle.bridge().counters().brake_escalations, 0);
  EXPECT_THAT(vehicle.reason(), HasSubstr("right drive (node 2): coasts at"));
}

TEST(Braking, AWheelThatNothingBrakesKeepsItsPowerAndIsNotReset) {
  Vehicle vehicle(drivetrain_of(19200));
  vehicle.drive(1.0);
  vehicle.drives().inject({0, DriveFault::Kind::weak_brake, 0.0}, vehicle.now());
  vehicle.bridge().stop(StopKind::quick);
  vehicle.run(3000);
  EXPECT_GT(vehicle.speed_mps(), 0.9);
  EXPECT_THAT(vehicle.reason(), HasSubstr("use the hard-wired emergency stop"));
  vehicle.reset_fault();
  vehicle.run(8000);
  EXPECT_EQ(vehicle.phase(), DrivePhase::refused) << vehicle.reason();
  EXPECT_EQ(vehicle.resets(), 0);
  vehicle.drives().inject({0, DriveFault::Kind::none, 0.0}, vehicle.now());
  vehicle.run(2000);
  vehicle.reset_fault();
  EXPECT_TRUE(vehicle.reaches(DrivePhase::standby, 8000)) << vehicle.reason();
  EXPECT_LE(vehicle.fastest_reset_mps(), 0.02);
}

TEST(Braking, HalfOfTheRequiredDecelerationIsEnough) {
  Vehicle enough(drivetrain_of(19200));
  enough.drive(1.0);
  enough.drives().inject({0, DriveFault::Kind::weak_brake, 0.5}, enough.now());  // 2 m/s²
  enough.bridge().stop(StopKind::quick);
  enough.run(1000);
  EXPECT_EQ(enough.bridge().counters().brake_escalations, 0);
  Vehicle weak(drivetrain_of(19200));
  weak.drive(1.0);
  weak.drives().inject({0, DriveFault::Kind::weak_brake, 0.25}, weak.now());  // 1 m/s²
  weak.bridge().stop(StopKind::quick);
  weak.run(1000);
  EXPECT_GT(weak.bridge().counters().brake_escalations, 0);
}

TEST(Braking, AWriteToTheQuickStopRampIsAnsweredByAStopThatDoesNotNeedIt) {
  Vehicle vehicle(drivetrain_of(19200));
  vehicle.drive(1.0);
  const double from_m = vehicle.way_m();
  vehicle.send(CanFrame::make(0x601, {0x23, 0x85, 0x60, 0, 192, 0, 0, 0}));
  vehicle.send(CanFrame::make(0x602, {0x23, 0x85, 0x60, 0, 192, 0, 0, 0}));
  const int stands_ms = vehicle.time_to_standstill_ms();
  fmt::print("measured: 0x6085 written by another: stands after {} ms, {:.2f} m\n", stands_ms,
             vehicle.way_m() - from_m);
  EXPECT_LE(stands_ms, 20 + 250 + 30);
  EXPECT_EQ(vehicle.bridge().counters().brake_escalations, 0);
}

}  // namespace
}  // namespace tether
