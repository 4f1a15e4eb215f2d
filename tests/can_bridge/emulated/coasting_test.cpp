#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/emulated/vehicle_rig.hpp"
#include "tests/support/source_dir.hpp"

// Wheels that roll on without power, at the decelerations that vehicles have, and are pushed.

namespace tether {
namespace {

using test::Vehicle;
using ::testing::HasSubstr;

/// The shipped drives without brakes; wheels of 0.4 m radius.
Cia402Config coasting(double deceleration_mps2) {
  auto config =
      std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/two_node_cia402.toml")));
  config.emulated_brake = false;
  config.emulated_coasting_radps2 = deceleration_mps2 / 0.4;
  return config;
}

class Coasting : public ::testing::TestWithParam<double> {
 protected:
  /// Until standby, as long as coasting may take.
  static bool comes_to_standby(Vehicle& vehicle) {
    return vehicle.reaches(DrivePhase::standby, 20'000);
  }
  Vehicle vehicle_{coasting(GetParam())};
};

TEST_P(Coasting, ANormalStopBrakesAndCutsPowerAtStandstill) {
  vehicle_.drive(1.0);
  vehicle_.bridge().stop(StopKind::quick);
  ASSERT_TRUE(vehicle_.reaches(DrivePhase::standby, 600)) << vehicle_.reason();
  EXPECT_LE(vehicle_.fastest_cut_mps(), 0.02);
}

TEST_P(Coasting, AfterADrivesOwnFaultNoResetComesBeforeItsWheelHasRolledOut) {
  vehicle_.drive(1.0);
  vehicle_.drives().inject({.node = 2, .kind = DriveFault::Kind::reboot}, vehicle_.now());
  vehicle_.run(600);
  ASSERT_EQ(vehicle_.phase(), DrivePhase::faulted);
  for (int s = 0; s < 12 && vehicle_.phase() != DrivePhase::standby; ++s) {
    vehicle_.reset_fault();
    vehicle_.run(1000);
    if (vehicle_.phase() == DrivePhase::standby) break;
    EXPECT_FALSE(vehicle_.bridge().snapshot(vehicle_.now()).standstill &&
                 vehicle_.speed_mps() > 0.05);
  }
  EXPECT_EQ(vehicle_.phase(), DrivePhase::standby) << vehicle_.reason();
  EXPECT_LE(vehicle_.fastest_reset_mps(), 0.03);
  EXPECT_LE(vehicle_.speed_mps(), 0.02);
}

INSTANTIATE_TEST_SUITE_P(Decelerations, Coasting, ::testing::Values(0.1, 0.3, 1.0, 8.0),
                         [](const auto& info) {
                           return fmt::format("{:.0f}cmps2", 100.0 * info.param);
                         });

TEST(Pushed, WheelsWithoutPowerThatAreTurnedDoNotStand) {
  Vehicle vehicle(coasting(0.3));
  ASSERT_TRUE(vehicle.reaches(DrivePhase::standby, 5000)) << vehicle.reason();
  EXPECT_TRUE(vehicle.bridge().snapshot(vehicle.now()).standstill);
  vehicle.drives().inject({0, DriveFault::Kind::push, 1.5}, vehicle.now());  // 0.6 m/s²
  vehicle.run(1000);
  EXPECT_GT(vehicle.speed_mps(), 0.2);
  EXPECT_FALSE(vehicle.bridge().snapshot(vehicle.now()).standstill);
  EXPECT_TRUE(vehicle.bridge().snapshot(vehicle.now()).turning);
  EXPECT_TRUE(vehicle.bridge().snapshot(vehicle.now()).in_doubt);
  vehicle.drives().inject({0, DriveFault::Kind::none, 0.0}, vehicle.now());
  vehicle.run(3000);
  EXPECT_TRUE(vehicle.bridge().snapshot(vehicle.now()).standstill);
}

TEST(Pushed, ALoadThatFrictionHoldsTurnsNothing) {
  Vehicle vehicle(coasting(0.3));
  ASSERT_TRUE(vehicle.reaches(DrivePhase::standby, 5000)) << vehicle.reason();
  vehicle.drives().inject({0, DriveFault::Kind::push, 0.5}, vehicle.now());  // 0.2 m/s²
  vehicle.run(1000);
  EXPECT_EQ(vehicle.speed_mps(), 0.0);
}

/// Stop from 1 m/s at each reaction, with drives that hold and drives that coast: the table
/// in docs/reference/drivetrain.md.
struct Reaction {
  const char* what;
  void (*begin)(Vehicle& vehicle);
};
class Reactions : public ::testing::TestWithParam<Reaction> {};

TEST_P(Reactions, StopTheVehicle) {
  for (const bool brake : {true, false}) {
    auto config = coasting(0.3);
    config.emulated_brake = brake;
    Vehicle vehicle(config);
    vehicle.drive(1.0);
    const double from_m = vehicle.way_m();
    GetParam().begin(vehicle);
    int noticed_ms = 0;
    for (; noticed_ms < 2000 && vehicle.speed_mps() > 0.98; ++noticed_ms) vehicle.run(1);
    const int stands_ms = noticed_ms + vehicle.time_to_standstill_ms();
    fmt::print("measured: {} ({}): brakes after {} ms, stands after {} ms, {:.2f} m\n",
               GetParam().what, brake ? "holds" : "coasts", noticed_ms, stands_ms,
               vehicle.way_m() - from_m);
    EXPECT_LT(stands_ms, 4000);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Measured, Reactions,
    ::testing::Values(Reaction{"quick stop", [](Vehicle& v) { v.bridge().stop(StopKind::quick); }},
                      Reaction{"bridge killed", [](Vehicle& v) { v.kill_bridge(); }},
                      Reaction{"a drive faults",
                               [](Vehicle& v) {
                                 v.drives().inject({1, DriveFault::Kind::fault, 0}, v.now());
                               }},
                      Reaction{"both drives lose power",
                               [](Vehicle& v) {
                                 v.drives().inject({0, DriveFault::Kind::reboot, 0}, v.now());
                               }},
                      Reaction{"one drive loses power",
                               [](Vehicle& v) {
                                 v.drives().inject({1, DriveFault::Kind::reboot, 0}, v.now());
                               }},
                      Reaction{"NMT pre-operational by another",
                               [](Vehicle& v) {
                                 v.send(CanFrame::make(0x000, {0x80, 0}));
                               }},
                      Reaction{"0x6085 written by another",
                               [](Vehicle& v) {
                                 v.send(CanFrame::make(0x601, {0x23, 0x85, 0x60, 0, 192, 0, 0, 0}));
                                 v.send(CanFrame::make(0x602, {0x23, 0x85, 0x60, 0, 192, 0, 0, 0}));
                               }},
                      Reaction{"polarity written by another",
                               [](Vehicle& v) {
                                 v.send(CanFrame::make(0x601, {0x2F, 0x7E, 0x60, 0, 0x40}));
                               }}),
    [](const auto& info) { return fmt::format("Row{}", info.index); });

}  // namespace
}  // namespace tether
