#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Others on the bus that send what only the bridge may send.
namespace tether {
namespace {

using testing::Bench;
using testing::expect_left_stops_and_stays_stopped;
using testing::milliseconds;

struct Intruder : ::testing::TestWithParam<std::uint32_t> {};

TEST_P(Intruder, WhoCommandsBesidesTheBridgeStopsBothWheels) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(GetParam(), {0x02, 0x7E}));
  EXPECT_EQ(bench.reason(),
            fmt::format("another sender uses 0x{:03X}: only one master may command", GetParam()));
  EXPECT_EQ(bench.profile.intruder(), fmt::format("0x{:03X} from another sender", GetParam()));
  EXPECT_EQ(bench.profile.counters().intruder_frames, 1);
  expect_left_stops_and_stays_stopped(bench);
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
}

INSTANTIATE_TEST_SUITE_P(Identifiers, Intruder,
                         ::testing::Values(0x000, 0x080, 0x201, 0x202, 0x301, 0x502, 0x77F));

TEST(Cia402Intruder, AToolThatReadsObjectsDoesNotCommand) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.deliver(CanFrame::make(0x601, {0x40, 0x00, 0x10, 0, 0, 0, 0, 0}));
  bench.deliver(CanFrame::make(0x581, {0x43, 0x00, 0x10, 0, 0, 0, 0, 0}));
  bench.deliver(CanFrame::make(0x602, {0x40, 0x08, 0x10, 0, 0, 0, 0, 0}));
  bench.deliver(CanFrame::make(0x602, {0x60, 0, 0, 0, 0, 0, 0, 0}));
  bench.deliver(CanFrame::make(0x602, {0x70, 0, 0, 0, 0, 0, 0, 0}));
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::enabled);
  EXPECT_EQ(bench.profile.counters().intruder_frames, 0);
  EXPECT_EQ(bench.profile.counters().rejected_frames, 0);
  EXPECT_EQ(bench.profile.intruder(), "");
}

TEST(Cia402Intruder, AToolThatWritesObjectsIsToldOfUntilTheNextReset) {
  Bench bench;
  bench.to_standby();
  bench.deliver(CanFrame::make(0x602, {0x2B, 0x17, 0x10, 0, 0x64, 0, 0, 0}));
  bench.deliver(CanFrame::make(0x602, {0x2B, 0x17, 0x10, 0, 0x64, 0, 0, 0}));
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  EXPECT_EQ(bench.profile.counters().intruder_frames, 2);
  EXPECT_EQ(bench.profile.intruder(), "0x602 from another sender");
  bench.profile.reset_fault();
  EXPECT_EQ(bench.profile.intruder(), "");
  EXPECT_EQ(bench.profile.counters().intruder_frames, 2);
}

TEST(Cia402Intruder, AnotherMasterAtStartUpIsFoundBeforeAnythingIsCommanded) {
  Bench bench;
  bench.profile.start(bench.now);
  bench.cycle();
  bench.deliver(CanFrame::make(0x77F, {0x05}));
  bench.run(milliseconds(500));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.left().resets, 0);
  EXPECT_EQ(bench.newest(0x201), nullptr);
  bench.profile.reset_fault();
  EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
}

}  // namespace
}  // namespace tether
