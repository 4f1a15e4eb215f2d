#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Motion of wheels while nothing is heard of their drives.
namespace tether {
namespace {

using canopen::NmtState;
using test::Bench;
using test::milliseconds;

/// Rolling; then the bridge is gone for the drives, which brake and are pre-operational, as with
/// 0x1029:1 = 0: no PDO any more.
struct Lost : Bench {
  Lost() {
    drive({1.0, 0.0}, milliseconds(1000));
    for (test::FakeDrive& d : drives) {
      d.nmt = NmtState::pre_operational;
      d.axes[0].ramp = 2;
    }
    counted_before = snapshot().wheels[0].position_counts;
    turned_before = left_axis().position;
    reach(DrivePhase::faulted, milliseconds(400));
    run_until([this] { return left_axis().speed == 0; });
    turned = left_axis().position - turned_before;
  }
  void reset() {
    profile.reset_fault();
    reach(DrivePhase::standby);
  }
  std::int64_t counted() const { return snapshot().wheels[0].position_counts - counted_before; }
  double uncounted_rad(std::size_t wheel = 0) const {
    return snapshot().wheels[wheel].uncounted_rad;
  }

  std::int64_t counted_before = 0, turned_before = 0, turned = 0;
};

/// A restart of a drive that stands takes less than 2 s; 0.05 rad/s count as standing.
constexpr double kRestart_rad = 0.1;

TEST(Cia402Gap, WhatDrivesTurnWithoutPdosIsReadBySdoBeforeTheyAreReset) {
  Lost bench;
  ASSERT_GT(bench.turned, 1000);
  ASSERT_EQ(bench.counted(), 0);
  bench.reset();
  ASSERT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  EXPECT_EQ(bench.counted(), bench.turned);
  EXPECT_LT(bench.uncounted_rad(), kRestart_rad);
  EXPECT_LT(bench.uncounted_rad(1), kRestart_rad);
}

TEST(Cia402Gap, ADriveThatRebootedUnheardIsNotBelieved) {
  Lost bench;
  bench.left_axis().position = bench.turned_before;
  std::vector<CanFrame> unheard;
  bench.left().reboot(unheard);
  bench.left_axis().position = bench.turned_before + 40;  // whatever it shows now
  bench.left().set_object(0x1017, 0, 100);                // but it has a heartbeat
  bench.reset();
  ASSERT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  EXPECT_EQ(bench.counted(), 0);
  // 95 rpm when it was lost.
  EXPECT_GT(bench.uncounted_rad(), 9.0 * 1.0);
  EXPECT_LT(bench.uncounted_rad(1), kRestart_rad) << "the other one did not reboot";
}

TEST(Cia402Gap, ADriveThatRebootsAtSpeedMayHaveRolledOn) {
  Bench bench;
  bench.drive({1.0, 0.0}, milliseconds(1000));
  const std::int64_t before = bench.snapshot().wheels[1].position_counts;
  std::vector<CanFrame> replies;
  bench.right().reboot(replies);
  for (const CanFrame& f : replies) bench.deliver(f);
  bench.right_axis().position = -5000;
  bench.run(milliseconds(1000));
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_EQ(bench.snapshot().wheels[1].position_counts, before);
  EXPECT_GT(bench.snapshot().wheels[1].uncounted_rad, 9.0 * 1.0);
}

}  // namespace
}  // namespace tether
