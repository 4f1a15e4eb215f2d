#include <gtest/gtest.h>

#include <numbers>

#include "tests/can_bridge/emulated/drive_rig.hpp"

namespace tether {
namespace {

using test::DriveRig;

constexpr double kLayoutRpm = 2.0 * std::numbers::pi / 60.0;

/// One node, axis 2 at +0x800 (IEC 61800-7-201: multiple axes in one device).
Cia402Config two_axes_by_offset() {
  Cia402Config c;
  AxisConfig& right = c.axes[1];
  for (ObjectRef* object : {&right.controlword, &right.statusword, &right.mode, &right.mode_display,
                            &right.target_velocity, &right.actual_velocity, &right.actual_position,
                            &right.error_code}) {
    object->index = static_cast<std::uint16_t>(object->index + 0x800);
  }
  c.watchdogs = {{.node = 1}};
  c.setup = {{.node = 1, .object = {0x605A, 0, 2, true}, .value = 2, .meaning = ""},
             {.node = 1, .object = {0x685A, 0, 2, true}, .value = 6, .meaning = ""}};
  return c;
}

/// One node, subindex 1 left and 2 right, one controlword, both statuswords in one, packed objects,
/// a vendor's watchdog: as in hub-motor drives for two wheels.
Cia402Config two_axes_by_subindex() {
  Cia402Config c;
  for (std::uint8_t side : {0, 1}) {
    AxisConfig& axis = c.axes[side];
    const auto sub = static_cast<std::uint8_t>(side + 1);
    axis.sign = side == 0 ? 1 : -1;
    axis.statusword = {0x6041, 0, 4, false};
    axis.statusword_shift = 16 * side;
    axis.target_velocity = {0x60FF, sub, 4, true};
    axis.actual_velocity = {0x606C, sub, 4, true};
    axis.actual_velocity_per_rps = {600, 1};
    axis.actual_position = {0x6064, sub, 4, true};
    axis.error_code = {0x603F, 0, 4, false};
  }
  c.watchdogs = {{.node = 1,
                  .kind = WatchdogConfig::Kind::milliseconds,
                  .object = {0x2000, 0, 2, false},
                  .timeout_ms = 200}};
  c.pdos = {{.node = 1, .number = 1, .objects = {{0x6040, 0, 2, false}, {0x60FF, 3, 4, false}}},
            {.node = 1, .number = 1, .transmit = true, .objects = {{0x606C, 3, 4, false}}}};
  return c;
}

TEST(EmulatedLayouts, TwoNodesAreTwoDevicesAndOneNodeIsOne) {
  EXPECT_EQ(DriveRig(test::two_node_drivetrain()).drives().nodes().size(), 2u);
  EXPECT_EQ(DriveRig(two_axes_by_offset()).drives().nodes().size(), 1u);
  EXPECT_EQ(DriveRig(two_axes_by_subindex()).drives().nodes().size(), 1u);
}

TEST(EmulatedLayouts, TheSecondAxisAtPlus800HasItsOwnStateMachineAndRamps) {
  DriveRig rig(two_axes_by_offset());
  rig.run(400);
  rig.write(1, 0x6860, 0, 1, 3);
  for (const int word : {0x06, 0x07, 0x0F}) {
    rig.write(1, 0x6840, 0, 2, word);
    rig.run(1);
  }
  EXPECT_EQ(rig.read(1, 0x6841, 0) & 0x6F, 0x27);
  EXPECT_EQ(rig.read(1, 0x6041, 0) & 0x4F, 0x40);
  EXPECT_EQ(rig.write(1, 0x6883, 0, 4, 60), 0);
  rig.write(1, 0x68FF, 0, 4, 60);
  rig.run(500);
  EXPECT_NEAR(rig.drives().wheel_targets_radps()[1], 30.0 * kLayoutRpm, 1e-6);
  EXPECT_EQ(rig.drives().wheel_targets_radps()[0], 0.0);
  rig.write(1, 0x685A, 0, 2, 6);
  rig.write(1, 0x6840, 0, 2, 0x02);
  rig.run(500);
  EXPECT_EQ(rig.read(1, 0x6841, 0) & 0x6F, 0x07) << "its own quick stop option: stays";
}

TEST(EmulatedLayouts, AnOptionOfAxisOneIsNotAxisTwos) {
  Cia402Config config = two_axes_by_offset();
  config.setup.pop_back();
  DriveRig rig(config);
  rig.run(400);
  EXPECT_EQ(rig.abort_of_read(1, 0x685A, 0), 0x06020000);
  EXPECT_EQ(rig.write(1, 0x605A, 0, 2, 6), 0);
  rig.write(1, 0x6860, 0, 1, 3);
  for (const int word : {0x06, 0x07, 0x0F, 0x02}) {
    rig.write(1, 0x6840, 0, 2, word);
    rig.run(2);
  }
  EXPECT_EQ(rig.read(1, 0x6841, 0) & 0x4F, 0x40) << "the standard's default, 2, not axis 1's 6";
}

TEST(EmulatedLayouts, TheReactionToALostConnectionIsTheWholeDevicesUnlessAxisTwoHasItsOwn) {
  for (const bool own : {false, true}) {
    Cia402Config config = two_axes_by_offset();
    config.setup.push_back({.node = 1, .object = {0x6007, 0, 2, true}, .meaning = ""});
    if (own) config.setup.push_back({.node = 1, .object = {0x6807, 0, 2, true}, .meaning = ""});
    DriveRig rig(config);
    rig.run(400);
    rig.write(1, 0x6007, 0, 2, 0);
    rig.write(1, 0x1016, 1, 4, 0x007F00FA);
    rig.heartbeat();
    rig.run(252);
    EXPECT_EQ(rig.read(1, 0x6041, 0) & 0x4F, 0x40);
    EXPECT_EQ(rig.read(1, 0x6841, 0) & 0x4F, own ? 0x08 : 0x40) << "its own is 1, fault";
  }
}

TEST(EmulatedLayouts, OneControlwordMovesBothAxesAndOneStatuswordShowsBoth) {
  DriveRig rig(two_axes_by_subindex());
  rig.enable_by_sdo();
  const std::int64_t both = rig.read(1, 0x6041, 0);
  EXPECT_EQ(both & 0x6F, 0x27);
  EXPECT_EQ(both >> 16 & 0x6F, 0x27);
  rig.write(1, 0x60FF, 2, 4, 60);
  rig.run(2);
  const std::int64_t moving = rig.read(1, 0x6041, 0);
  EXPECT_EQ(moving >> 10 & 1, 1) << "left is at its target";
  EXPECT_EQ(moving >> 26 & 1, 0) << "right is not";
}

TEST(EmulatedLayouts, AxesBySubindexHaveTheirRampsThereToo) {
  DriveRig rig(two_axes_by_subindex());
  rig.run(400);
  EXPECT_EQ(rig.read(1, 0x6083, 0), 2) << "highest subindex";
  EXPECT_EQ(rig.write(1, 0x6083, 1, 4, 50), 0);
  EXPECT_EQ(rig.write(1, 0x6083, 2, 4, 70), 0);
  EXPECT_EQ(rig.abort_of_read(1, 0x6083, 3), 0x06090011);
}

TEST(EmulatedLayouts, APackedTargetSetsBothWheelsAndAPackedSpeedShowsBoth) {
  DriveRig rig(two_axes_by_subindex());
  rig.enable_by_sdo();
  rig.write(1, 0x6083, 1, 4, 60'000);
  rig.write(1, 0x6083, 2, 4, 60'000);
  EXPECT_EQ(rig.write(1, 0x60FF, 3, 4, 0xFFD8'0028), 0);  // −40, 40
  rig.run(10);
  EXPECT_EQ(rig.read_signed(1, 0x60FF, 2), -40);
  EXPECT_NEAR(rig.drives().wheel_targets_radps()[0], 40.0 * kLayoutRpm, 1e-9);
  EXPECT_NEAR(rig.drives().wheel_targets_radps()[1], 40.0 * kLayoutRpm, 1e-9);
  EXPECT_EQ(rig.read_signed(1, 0x606C, 1), 400) << "tenths of rpm";
  EXPECT_EQ(rig.read(1, 0x606C, 3), 0xFE70'0190);
}

TEST(EmulatedLayouts, PackedObjectsMayBeMapped) {
  DriveRig rig(two_axes_by_subindex());
  rig.run(400);
  rig.write(1, 0x1401, 1, 4, 0x80000301);
  EXPECT_EQ(rig.write(1, 0x1601, 1, 4, 0x60FF0320), 0);
  EXPECT_EQ(rig.write(1, 0x1A01, 1, 4, 0x606C0320), 0);
  EXPECT_EQ(rig.write(1, 0x1601, 2, 4, 0x606C0320), 0x06040041) << "a speed is read-only";
}

TEST(EmulatedLayouts, AFaultOfADualAxisDriveStopsBothAndHasOneCodeEach) {
  DriveRig rig(two_axes_by_subindex());
  rig.enable_by_sdo();
  rig.forget_sent();
  rig.drives().inject({1, DriveFault::Kind::fault, 0x2310}, rig.now());
  rig.run(3);
  EXPECT_EQ(rig.sent(0x081).size(), 1u);
  EXPECT_EQ(rig.read(1, 0x603F, 0), 0x2310'2310);
  EXPECT_EQ(rig.read(1, 0x6041, 0) & 0x004F'004F, 0x0008'0008);
}

TEST(EmulatedLayouts, TheVendorsDriveHasNoneOfTheStandardsWatchdogs) {
  DriveRig rig(two_axes_by_subindex());
  rig.run(400);
  for (const std::uint16_t index : {0x1016, 0x1029, 0x6007, 0x605A, 0x605E}) {
    EXPECT_EQ(rig.abort_of_read(1, index, 0), 0x06020000) << std::hex << index;
  }
  EXPECT_EQ(rig.read(1, 0x2000, 0), 0);
}

}  // namespace
}  // namespace tether
