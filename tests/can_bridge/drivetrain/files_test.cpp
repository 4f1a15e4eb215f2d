#include <gmock/gmock.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

template <class Config = Cia402Config>
Config shipped(const std::string& name) {
  return std::get<Config>(load_drivetrain(in_source("/drivetrains/") + name));
}

TEST(ShippedDrivetrains, AllLoadAndHaveANameOfTheirOwn) {
  std::set<std::string> names;
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(in_source("/drivetrains"))) {
    if (entry.path().extension() != ".toml") continue;
    ++files;
    std::visit([&](const DrivetrainCommon& c) { names.insert(c.name); },
               load_drivetrain(entry.path().string()));
  }
  EXPECT_GE(files, 4);
  EXPECT_EQ(names.size(), static_cast<std::size_t>(files));
}

TEST(ControlCycle, OutlastsOneLostFrameInEveryTimeOut) {
  using ::testing::HasSubstr;
  Cia402Config c = shipped("two_node_cia402.toml");
  check_cycle(c, 1.0);
  check_cycle(c, 20.0);
  check_cycle(c, 33.0);
  const auto refusal = [&](double cycle_ms) -> std::string {
    return refusal_of([&] { check_cycle(c, cycle_ms); });
  };
  EXPECT_THAT(refusal(34.0), HasSubstr("can.cycle_ms = 34"));
  EXPECT_THAT(refusal(34.0), HasSubstr("drives.feedback_timeout_ms = 100"));
  c.feedback_timeout_ms = 1000;
  EXPECT_THAT(refusal(34.0), HasSubstr("pdo.event_timer_ms = 100"));
  c.pdos[0].event_timer_ms = c.pdos[1].event_timer_ms = 0;  // not watched
  EXPECT_EQ(refusal(34.0), "accepted");
  // Heartbeats of 60 ms leave every 84 ms, the third after 252.
  EXPECT_THAT(refusal(42.0), HasSubstr("watchdog.timeout_ms = 250"));
  EXPECT_NO_THROW(check_cycle(AgilexV2Config{}, 42.0));
}

TEST(ShippedDrivetrains, TwoNodesDriveOneWheelEachAndTheRightOneIsMirrored) {
  const Cia402Config c = shipped("two_node_cia402.toml");
  EXPECT_EQ(c.axes[0].node, 1);
  EXPECT_EQ(c.axes[1].node, 2);
  EXPECT_EQ(c.axes[0].sign, 1);
  EXPECT_EQ(c.axes[1].sign, -1);
  EXPECT_EQ(c.master_node, 0x7F);
  EXPECT_EQ(c.heartbeat_ms, 60);
  EXPECT_TRUE(c.sync);
  EXPECT_EQ(c.axes[1].target_velocity, (ObjectRef{0x60FF, 0, 4, true}));
  EXPECT_EQ(c.axes[0].target_velocity_per_rps.value(), 12000.0);
  EXPECT_EQ(c.axes[0].counts_per_revolution.value(), 81920.0);
  ASSERT_EQ(c.watchdogs.size(), 2U);
  EXPECT_EQ(c.watchdogs[1].node, 2);
  EXPECT_EQ(c.watchdogs[1].object, (ObjectRef{0x1016, 1, 4, false}));
  EXPECT_EQ(c.watchdogs[1].timeout_ms, 250);
  EXPECT_TRUE(c.emulated_brake);
}

TEST(ShippedDrivetrains, WhatWatchesTheHeartbeatBrakesByQuickStop) {
  for (const char* const file : {"two_node_cia402.toml", "dual_axis_cia402.toml"}) {
    for (const WatchdogConfig& watchdog : shipped(file).watchdogs) {
      EXPECT_EQ(watchdog.reaction, (ObjectRef{0x6007, 0, 2, true})) << file;
      EXPECT_EQ(watchdog.reaction_value, 3) << file;
    }
  }
}

TEST(ShippedDrivetrains, TwoNodesHaveTheUsualProcessDataEach) {
  const Cia402Config c = shipped("two_node_cia402.toml");
  ASSERT_EQ(c.pdos.size(), 6U);
  const PdoConfig& rpdo = c.pdos[1];
  EXPECT_EQ(rpdo.node, 2);
  EXPECT_FALSE(rpdo.transmit);
  EXPECT_EQ(rpdo.transmission, 1);
  EXPECT_EQ(rpdo.event_timer_ms, 100);
  EXPECT_EQ(rpdo.objects, (std::vector<ObjectRef>{{0x6040, 0, 2, false}, {0x60FF, 0, 4, true}}));
  const PdoConfig& tpdo = c.pdos[4];
  EXPECT_EQ(tpdo.node, 1);
  EXPECT_TRUE(tpdo.transmit);
  EXPECT_EQ(tpdo.number, 2);
  EXPECT_EQ(tpdo.objects, (std::vector<ObjectRef>{
                              {0x6064, 0, 4, true}, {0x603F, 0, 2, false}, {0x6061, 0, 1, true}}));
}

TEST(ShippedDrivetrains, SpeedsOfTwoNodesAreQuantisedFinerThanAMillimetrePerSecond) {
  const double rim_m = 2.0 * 3.14159265358979 * 0.4;
  for (const AxisConfig& axis : shipped("two_node_cia402.toml").axes) {
    EXPECT_LT(rim_m / axis.target_velocity_per_rps.value(), 1e-3);
    EXPECT_LT(rim_m / axis.actual_velocity_per_rps.value(), 1e-3);
    EXPECT_LT(rim_m / axis.counts_per_revolution.value(), 1e-3);
    // 20 m/s still fit the object.
    EXPECT_LT(20.0 / rim_m * axis.target_velocity_per_rps.value(), 2147483647.0);
  }
}

TEST(ShippedDrivetrains, TheSecondAxisOfOneNodeIs0x800Higher) {
  const Cia402Config c = shipped("dual_axis_cia402.toml");
  EXPECT_EQ(c.axes[0].node, c.axes[1].node);
  EXPECT_EQ(c.axes[0].controlword.index, 0x6040);
  EXPECT_EQ(c.axes[1].controlword.index, 0x6840);
  EXPECT_EQ(c.axes[1].statusword.index, 0x6841);
  EXPECT_EQ(c.axes[1].mode.index, 0x6860);
  EXPECT_EQ(c.axes[1].mode_display.index, 0x6861);
  EXPECT_EQ(c.axes[1].target_velocity.index, 0x68FF);
  EXPECT_EQ(c.axes[1].actual_velocity.index, 0x686C);
  EXPECT_EQ(c.axes[1].actual_position.index, 0x6864);
  EXPECT_EQ(c.axes[1].error_code.index, 0x683F);
  EXPECT_EQ(c.pdos[1].objects.front(), c.axes[1].controlword);
}

TEST(ShippedDrivetrains, ZlacTellsItsAxesApartBySubindexAndHasItsOwnWatchdog) {
  const Cia402Config c = shipped("zlac8015d.toml");
  EXPECT_EQ(c.axes[0].target_velocity, (ObjectRef{0x60FF, 1, 4, true}));
  EXPECT_EQ(c.axes[1].target_velocity, (ObjectRef{0x60FF, 2, 4, true}));
  EXPECT_EQ(c.axes[0].controlword, c.axes[1].controlword);
  EXPECT_EQ(c.axes[0].statusword, c.axes[1].statusword);
  EXPECT_EQ(c.axes[0].statusword_shift, 0);
  EXPECT_EQ(c.axes[1].statusword_shift, 16);
  EXPECT_FALSE(c.sync);
  ASSERT_EQ(c.watchdogs.size(), 1U);
  EXPECT_EQ(c.watchdogs[0].kind, WatchdogConfig::Kind::milliseconds);
  EXPECT_EQ(c.watchdogs[0].object, (ObjectRef{0x2000, 0, 2, false}));
}

TEST(ShippedDrivetrains, AnAgilexChassisIsDescribedByItsOwnFigures) {
  const auto c = shipped<AgilexV2Config>("agilex_v2.toml");
  EXPECT_EQ(c.chassis_wheel_radius_m, 0.4);
  EXPECT_EQ(c.chassis_track_m, 1.2);
  EXPECT_EQ(c.step_timeout_ms, 1000);
}

}  // namespace
}  // namespace tether
