#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/can_bridge/emulated/vehicle_rig.hpp"
#include "tests/support/source_dir.hpp"

// Stops that drives do not hear by PDO, in virtual time; and one drive that fails alone.

namespace tether {
namespace {

using test::Vehicle;
using ::testing::HasSubstr;

Cia402Config shipped(const std::string& name = "two_node_cia402") {
  return std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/") + name + ".toml"));
}

const CanFrame kPreOperational = canopen::nmt_frame(canopen::NmtCommand::pre_operational, 0);

class EachDrivetrain : public ::testing::TestWithParam<const char*> {};

TEST_P(EachDrivetrain, OneNmtFrameToPreOperationalStopsTheVehicle) {
  Vehicle vehicle(shipped(GetParam()));
  vehicle.drive(1.0);
  vehicle.send(kPreOperational);
  // One cycle, 1 m/s at 4 m/s², and for ZLAC's second axis another cycle.
  EXPECT_LE(vehicle.time_to_standstill_ms(), 20 + 250 + 30);
  vehicle.run(400);
  EXPECT_FALSE(vehicle.bridge().snapshot(vehicle.now()).in_doubt);
  EXPECT_EQ(vehicle.bridge().counters().heartbeat_withheld, 0);
  vehicle.reset_fault();
  EXPECT_TRUE(vehicle.reaches(DrivePhase::standby, 8000)) << vehicle.reason();
}

INSTANTIATE_TEST_SUITE_P(UnheardStop, EachDrivetrain,
                         ::testing::Values("two_node_cia402", "dual_axis_cia402", "zlac8015d"),
                         [](const auto& info) { return std::string(info.param); });

TEST(UnheardStop, OneDriveThatLeavesOperationalByItselfStopsBoth) {
  int longest_ms = 0;
  // Whenever that is between two of its heartbeats.
  for (int phase_ms = 0; phase_ms < 100; phase_ms += 11) {
    Vehicle vehicle(shipped());
    vehicle.drive(1.0);
    vehicle.run(phase_ms);
    vehicle.send(canopen::nmt_frame(canopen::NmtCommand::pre_operational, 2), false);
    longest_ms = std::max(longest_ms, vehicle.time_to_standstill_ms());
    EXPECT_EQ(vehicle.phase(), DrivePhase::faulted);
  }
  fmt::print("measured: a drive leaves operational -> wheels stand after at most {} ms\n",
             longest_ms);
  // Its TPDOs or its heartbeat tell within 100 ms, a cycle, 1 m/s at 4 m/s².
  EXPECT_LE(longest_ms, 100 + 20 + 250 + 20);
}

TEST(UnheardStop, ADriveThatTakesNoSdoEitherIsStoppedByItsOwnWatchdog) {
  Vehicle vehicle(shipped());
  vehicle.drive(1.0);
  vehicle.drives().inject({.node = 0, .kind = DriveFault::Kind::sdo_abort}, vehicle.now());
  vehicle.send(kPreOperational);
  // 200 ms without confirmation, 250 ms without heartbeat, then 1 m/s at 4 m/s².
  EXPECT_LE(vehicle.time_to_standstill_ms(), 20 + 200 + 60 + 250 + 250);
  EXPECT_THAT(vehicle.reason(), HasSubstr("heartbeat and setpoints are withheld"));
  EXPECT_EQ(vehicle.bridge().counters().heartbeat_withheld, 1);
  EXPECT_TRUE(vehicle.bridge().snapshot(vehicle.now()).in_doubt);
}

TEST(UnheardStop, ANmtStopIsFollowedByASdoQuickStopToo) {
  Vehicle vehicle(shipped());
  vehicle.drive(1.0);
  vehicle.send(canopen::nmt_frame(canopen::NmtCommand::stop, 0));
  EXPECT_LE(vehicle.time_to_standstill_ms(), 20 + 250 + 20);
  vehicle.run(400);
  EXPECT_FALSE(vehicle.bridge().snapshot(vehicle.now()).in_doubt);
}

/// From the fault of the right drive, whose wheel then coasts (1 rad/s², that is 0.4 m/s²) or is
/// held, until both wheels stand; the left one brakes at 4 m/s².
struct OneDriveFaults {
  OneDriveFaults(bool held, double v_mps) {
    Cia402Config config = shipped();
    config.emulated_brake = held;
    for (SetupWrite& setup : config.setup) {
      if (setup.object.index == 0x605E) setup.value = 0;
    }
    Vehicle vehicle(config);
    vehicle.drive(v_mps);
    const double before_rad = vehicle.yaw_rad();
    vehicle.drives().inject({.node = 2, .kind = DriveFault::Kind::fault}, vehicle.now());
    for (; vehicle.rim_mps(0) > 0.02 && healthy_ms < 10'000; ++healthy_ms) vehicle.run(1);
    all_ms = healthy_ms + vehicle.time_to_standstill_ms();
    yaw_rad = vehicle.yaw_rad() - before_rad;
    fmt::print(
        "measured at {} m/s: healthy wheel stands after {} ms, both after {} ms, {:.2f} rad\n",
        v_mps, healthy_ms, all_ms, yaw_rad);
  }
  int healthy_ms = 0;
  int all_ms = 0;
  double yaw_rad = 0.0;
};

TEST(OneDriveFaults,
     TheOtherBrakesOnItsQuickStopRampAndTheVehicleTurnsAsFarAsTheCoastingWheelRolls) {
  for (const double v_mps : {0.5, 1.0}) {
    const OneDriveFaults run(false, v_mps);
    EXPECT_NEAR(run.healthy_ms, v_mps / 4.0 * 1e3, 40);
    const double coasted_m = v_mps * v_mps / (2.0 * 0.4), braked_m = v_mps * v_mps / (2.0 * 4.0);
    EXPECT_NEAR(run.yaw_rad, (coasted_m - braked_m) / VehicleConfig{}.track_m, 0.05);
  }
}

TEST(OneDriveFaults, AWheelThatIsHeldAtOnceTurnsTheVehicleByTheOthersBrakingDistance) {
  const OneDriveFaults run(true, 1.0);
  EXPECT_NEAR(run.yaw_rad, -0.125 / VehicleConfig{}.track_m, 0.03);
  EXPECT_LE(run.all_ms, 290);
}

}  // namespace
}  // namespace tether
