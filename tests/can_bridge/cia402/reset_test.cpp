#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// How faults are reset.
namespace tether {
namespace {

using canopen::DriveState;
using test::Bench;
using test::emergency;
using test::milliseconds;

TEST(Cia402Reset, ResetIsARisingEdgeOfBit7AtTheFaultyAxisOnlyAndNeverEnables) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.right().trip(bench.right_axis(), 0x3210);
  bench.run(milliseconds(1000));
  ASSERT_EQ(bench.phase(), DrivePhase::faulted);
  bench.log.clear();
  bench.profile.reset_fault();
  EXPECT_EQ(bench.phase(), DrivePhase::starting);
  ASSERT_TRUE(bench.reach(DrivePhase::standby, milliseconds(500)));
  std::vector<int> right;
  for (const CanFrame& f : bench.log) {
    if (f.id == 0x201) {
      EXPECT_EQ(f.data[0], 0);
    }
    if (f.id == 0x202 && (right.empty() || right.back() != f.data[0])) right.push_back(f.data[0]);
  }
  EXPECT_THAT(right, ::testing::ElementsAre(0x80, 0x00));
  EXPECT_EQ(bench.snapshot().wheels[1].error_code, 0u);
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  EXPECT_EQ(bench.right_axis().state, DriveState::switch_on_disabled);
}

TEST(Cia402Reset, ASecondResetIsASecondRisingEdge) {
  Bench bench;
  bench.to_standby();
  bench.right().trip(bench.right_axis(), 0xFFFF);  // cannot be reset
  bench.run(milliseconds(100));
  bench.log.clear();
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(1100)));
  EXPECT_EQ(bench.reason(),
            "right drive (node 2): fault 0xFFFF (vendor's own, see the drive's manual) cannot be "
            "reset: remove the cause, then reset");
  bench.run(milliseconds(100));
  bench.right_axis().error = 0x3210;
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(200)));
}

TEST(Cia402Reset, NoResetBeforeTheFaultReactionIsOver) {
  Bench bench;
  bench.to_standby();
  bench.right().trip(bench.right_axis(), 0x3210);
  bench.run(milliseconds(100));
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::standby));  // an earlier reset leaves nothing behind
  bench.right().send_feedback = false;
  const CanFrame reacting = CanFrame::make(0x182, {0x1F, 0x02, 0, 0, 0, 0});
  bench.deliver(reacting);
  bench.cycle();
  bench.profile.reset_fault();
  for (int i = 0; i < 10; ++i) {
    bench.deliver(reacting);
    bench.cycle();
    EXPECT_EQ(bench.controlword(0x202) & 0x80, 0);
  }
  bench.deliver(CanFrame::make(0x182, {0x18, 0x02, 0, 0, 0, 0}));
  bench.cycle();
  EXPECT_EQ(bench.controlword(0x202), 0x0080);
}

TEST(Cia402Reset, AFaultDuringTheResetIsLatchedAgain) {
  Bench bench;
  bench.to_standby();
  bench.right().trip(bench.right_axis(), 0x3210);
  bench.run(milliseconds(100));
  bench.profile.reset_fault();
  bench.deliver(emergency(1, 0x7500));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Reset, ResetOutsideOfAFaultDoesNothing) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.profile.reset_fault();
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::enabled);
}

TEST(Cia402Reset, AResetThatFollowsAtOnceLowersTheBitFirst) {
  Bench bench;
  bench.to_standby();
  bench.right().trip(bench.right_axis(), 0xFFFF);
  bench.run(milliseconds(100));
  bench.log.clear();
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.run_until([&] { return bench.controlword(0x202) == 0x0080; }));
  bench.cycle();
  bench.deliver(emergency(1, 0x7500));  // ends the reset
  bench.profile.reset_fault();
  bench.run(milliseconds(200));
  int rising_edges = 0;
  bool high = false;
  for (const CanFrame& f : bench.log) {
    if (f.id != 0x202) continue;
    rising_edges += !high && (f.data[0] & 0x80) != 0 ? 1 : 0;
    high = (f.data[0] & 0x80) != 0;
  }
  EXPECT_EQ(rising_edges, 2);
}

TEST(Cia402Reset, AClearedEmergencyIsNotShownAnyLonger) {
  Bench bench;
  bench.to_standby();
  bench.deliver(emergency(2, 0x8140));
  bench.cycle();
  EXPECT_EQ(bench.snapshot().wheels[1].error_code, 0x8140u);
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::standby, milliseconds(200)));
  EXPECT_EQ(bench.snapshot().wheels[1].error_code, 0u);
}

}  // namespace
}  // namespace tether
