#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/base/errors.hpp"
#include "tests/can_bridge/cia402/bench.hpp"

// Layouts other than two nodes of one axis each, and those that cannot work.
namespace tether {
namespace {

using canopen::DriveState;
using test::Bench;
using test::milliseconds;
using test::pdo;
using test::two_nodes;

/// One node; the second axis' objects 0x800 further on.
Cia402Config dual_axis() {
  Cia402Config c;
  c.name = "dual axis";
  AxisConfig& right = c.axes[1];
  for (ObjectRef* o : {&right.controlword, &right.statusword, &right.mode, &right.mode_display,
                       &right.target_velocity, &right.actual_velocity, &right.actual_position,
                       &right.error_code}) {
    o->index = static_cast<std::uint16_t>(o->index + 0x800);
  }
  right.sign = -1;
  c.watchdogs = {{}};
  for (int i = 0; i < 2; ++i) {
    const AxisConfig& a = c.axes[static_cast<std::size_t>(i)];
    c.pdos.push_back(pdo(1, i + 1, false, {a.controlword, a.target_velocity}));
    c.pdos.push_back(pdo(1, 2 * i + 1, true, {a.statusword, a.actual_velocity}));
    c.pdos.push_back(pdo(1, 2 * i + 2, true, {a.actual_position, a.error_code, a.mode_display}));
  }
  return c;
}

/// Like a ZLAC8015D: axes in subindices, one controlword, both statuswords in 32 bits, a vendor's
/// watchdog, no 0x1016, no SYNC.
Cia402Config shared_controlword() {
  Cia402Config c;
  c.name = "shared controlword";
  c.sync = false;
  for (std::size_t i = 0; i < 2; ++i) {
    AxisConfig& a = c.axes[i];
    const auto sub = static_cast<std::uint8_t>(i + 1);
    a.statusword = {0x6041, 0, 4, false};
    a.statusword_shift = i == 0 ? 0 : 16;
    a.target_velocity = {0x60FF, sub, 4, true};
    a.actual_velocity = {0x606C, sub, 4, true};
    a.actual_position = {0x6064, sub, 4, true};
    a.error_code = {0x603F, sub, 2, false};
    a.actual_velocity_per_rps = {600, 1};
  }
  c.axes[1].sign = -1;
  c.watchdogs = {{1, WatchdogConfig::Kind::milliseconds, {0x2000, 0, 2, false}, 250}};
  const auto& [l, r] = c.axes;
  c.pdos.push_back(pdo(1, 1, false, {l.controlword}, 255));
  c.pdos.push_back(pdo(1, 2, false, {l.target_velocity, r.target_velocity}, 255));
  c.pdos.push_back(pdo(1, 1, true, {l.statusword, l.mode_display}, 255));
  c.pdos.push_back(pdo(1, 2, true, {l.actual_velocity, r.actual_velocity}, 255));
  c.pdos.push_back(pdo(1, 3, true, {l.actual_position, r.actual_position}, 255));
  c.pdos.push_back(pdo(1, 4, true, {l.error_code, r.error_code}, 255));
  return c;
}

std::int64_t value_at(const CanFrame& f, std::size_t offset) {
  return canopen::read_integer(f.data.data() + offset, 4, true);
}

TEST(Cia402Layout, ADualAxisNodeIsStartedOnceAndBothModesAreSet) {
  Bench bench(dual_axis());
  bench.to_standby();
  ASSERT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  EXPECT_EQ(bench.count(CanFrame::make(0, {0x81, 1})), 1);
  EXPECT_EQ(bench.left().object(0x6060, 0), 3);
  EXPECT_EQ(bench.left().object(0x6860, 0), 3);
}

TEST(Cia402Layout, DualAxesAreCommandedInPdosOfTheirOwn) {
  Bench bench(dual_axis());
  bench.drive({0.5, 0.0});
  EXPECT_EQ(bench.target(0x201), 48);
  EXPECT_EQ(bench.target(0x301), -48);
  EXPECT_NEAR(bench.snapshot().wheels[0].speed_radps, 5.0, 0.1);
  EXPECT_NEAR(bench.snapshot().wheels[1].speed_radps, 5.0, 0.1);
}

TEST(Cia402Layout, AFaultOfOneOfDualAxesStopsTheOther) {
  Bench bench(dual_axis());
  bench.drive({1.0, 0.0});
  bench.left().trip(bench.right_axis(), 0x7305);
  bench.cycle();
  EXPECT_EQ(bench.reason(),
            "right drive (node 1): fault 0x7305 (incremental encoder fault: encoder plug): remove "
            "the cause, then reset");
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.left_axis().state, DriveState::switch_on_disabled);
}

TEST(Cia402Layout, ReasonsOfASharedNodeNameTheNodeOnly) {
  Bench bench(dual_axis());
  bench.left().aborts[{0x1016, 1}] = 0x06020000;
  bench.profile.start(bench.now);
  ASSERT_TRUE(bench.reach(DrivePhase::refused));
  EXPECT_THAT(bench.reason(), ::testing::StartsWith("drive (node 1): no drive-side watchdog"));
}

TEST(Cia402Layout, SharedControlwordEnablesBothAxesAndDrives) {
  Bench bench(shared_controlword());
  for (auto& axis : bench.left().axes) axis.ramp = 100;
  bench.drive({0.5, 0.0});
  ASSERT_EQ(bench.phase(), DrivePhase::enabled) << bench.reason();
  EXPECT_EQ(bench.newest(0x080), nullptr);
  EXPECT_EQ(*bench.newest(0x201), CanFrame::make(0x201, {0x0F, 0x00}));
  const CanFrame targets = *bench.newest(0x301);
  EXPECT_EQ(targets.size, 8);
  EXPECT_EQ(value_at(targets, 0), 48);
  EXPECT_EQ(value_at(targets, 4), -48);
  EXPECT_EQ(bench.snapshot().wheels[1].state, "OperationEnabled");
  EXPECT_NEAR(bench.snapshot().wheels[0].speed_radps, 5.0, 0.1);
  EXPECT_NEAR(bench.snapshot().wheels[1].speed_radps, 5.0, 0.1);
}

TEST(Cia402Layout, SharedControlwordWaitsForTheSlowerAxis) {
  Bench bench(shared_controlword());
  bench.to_standby();
  bench.enable_verified();
  bench.right_axis().stuck_below = DriveState::ready_to_switch_on;
  bench.run(milliseconds(400));
  EXPECT_EQ(bench.newest(0x201)->data[0], 0x07);
  EXPECT_EQ(bench.left_axis().state, DriveState::switched_on);
  bench.right_axis().stuck_below.reset();
  EXPECT_TRUE(bench.reach(DrivePhase::enabled, milliseconds(200)));
}

TEST(Cia402Layout, SharedControlwordBrakesTheHealthyAxisBeforeItGoesOff) {
  Bench bench(shared_controlword());
  for (auto& axis : bench.left().axes) axis.ramp = 100;
  bench.drive({1.0, 0.0});
  bench.left().trip(bench.right_axis(), 0x3210);
  bench.cycle();
  bench.cycle();
  EXPECT_EQ(bench.newest(0x201)->data[0], 0x02);
  EXPECT_EQ(bench.left_axis().state, DriveState::quick_stop_active);
  ASSERT_TRUE(
      bench.run_until([&] { return bench.newest(0x201)->data[0] == 0; }, milliseconds(1000)));
  EXPECT_EQ(bench.left_axis().speed, 0);
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(500))) << bench.reason();
  EXPECT_EQ(bench.right_axis().state, DriveState::switch_on_disabled);
}

TEST(Cia402Layout, TheVendorsWatchdogCounts) {
  Bench bench(shared_controlword());
  bench.to_standby();
  EXPECT_EQ(bench.left().object(0x2000, 0), 250);
  Bench off(shared_controlword());
  off.left().clamps[{0x2000, 0}] = 0;
  off.profile.start(off.now);
  ASSERT_TRUE(off.reach(DrivePhase::refused));
  EXPECT_THAT(off.reason(), ::testing::HasSubstr("0x2000:0 (watchdog) reads 0 instead of 250"));
}

// ---------------------------------------------------------------------------- cannot work

std::string complaint(const Cia402Config& config) {
  try {
    const Cia402Profile profile(config, 0.1, 0.5);
  } catch (const UsageError& e) {
    return e.what();
  }
  return "none";
}

TEST(Cia402Layout, AnAxisWithoutSetpointOrFeedbackInAPdoIsAnError) {
  Cia402Config c = two_nodes();
  c.pdos[3].objects.pop_back();
  EXPECT_EQ(complaint(c),
            "two nodes: no RPDO carries the right drive (node 2)'s 0x60FF:0 (target velocity)");
  c = two_nodes();
  c.pdos[2].objects.erase(c.pdos[2].objects.begin());
  EXPECT_EQ(complaint(c),
            "two nodes: no TPDO carries the left drive (node 1)'s 0x6064:0 (actual position)");
}

TEST(Cia402Layout, AnUnknownObjectInASetpointPdoIsAnError) {
  Cia402Config c = two_nodes();
  c.pdos[0].objects.push_back({0x6071, 0, 2, true});
  EXPECT_EQ(complaint(c), "two nodes: RPDO1 of node 1 maps 0x6071:0, which commands no axis");
}

TEST(Cia402Layout, APdoOfMoreThanEightBytesIsAnError) {
  Cia402Config c = two_nodes();
  c.pdos[2].objects.push_back({0x2001, 0, 4, false});
  EXPECT_EQ(complaint(c), "two nodes: TPDO2 of node 1 maps more than 8 bytes");
}

TEST(Cia402Layout, AnObjectOfAnotherSizeThanTheAxisSaysIsAnError) {
  Cia402Config c = two_nodes();
  c.pdos[1].objects[1].bytes = 2;
  EXPECT_EQ(complaint(c),
            "two nodes: TPDO1 of node 1 maps 0x606C:0 with 2 bytes, but the left drive (node 1) "
            "has it with 4");
}

TEST(Cia402Layout, DummiesAndForeignFeedbackAreAllowed) {
  Cia402Config c = two_nodes();
  c.pdos[0].objects.push_back({0x0005, 0, 1, false});
  c.pdos[0].objects.push_back({0x6060, 0, 1, true});
  c.pdos[1].objects.push_back({0x6077, 0, 2, true});
  Bench bench(c);
  bench.to_enabled();
  EXPECT_EQ(bench.phase(), DrivePhase::enabled) << bench.reason();
  EXPECT_EQ(bench.newest(0x201)->data[7], 3);
}

}  // namespace
}  // namespace tether
