#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

// Others on the bus that send what only the bridge may send.
namespace tether {
namespace {

using test::Bench;
using test::expect_left_stops_and_stays_stopped;
using test::milliseconds;

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

CanFrame standing_right() { return CanFrame::make(0x182, {0x37, 0x02, 0, 0, 0, 0}); }

TEST(Cia402Intruder, ASecondSourceOfFeedbackStopsBothWheelsInItsThirdSyncPeriod) {
  Bench bench;
  bench.drive({1.0, 0.0});
  for (int i = 0; i < 2; ++i) {
    bench.cycle();
    bench.deliver(standing_right());
    EXPECT_EQ(bench.phase(), DrivePhase::enabled);
  }
  bench.cycle();
  bench.deliver(standing_right());
  EXPECT_EQ(bench.reason(),
            "two sources send 0x182, feedback of right drive (node 2): has another device its node "
            "id, or are its frames replayed? Feedback is not believed");
  EXPECT_EQ(bench.profile.counters().surplus_feedback, 3);
  bench.profile.set_command({1.0, 0.0});
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.controlword(0x201), 0x0002);
  EXPECT_EQ(bench.target(0x202), 0);
}

TEST(Cia402Intruder, ForgedStandstillSwitchesNoPowerStageOffUntil5sAfterItsEnd) {
  Bench bench;
  bench.drive({1.0, 0.0}, milliseconds(1000));
  bench.left_axis().ramp = bench.right_axis().ramp = 1;
  for (int i = 0; i < 3; ++i) {
    bench.cycle();
    bench.deliver(standing_right());
  }
  ASSERT_EQ(bench.phase(), DrivePhase::faulted);
  const Instant since = bench.now;
  while (bench.now < since + milliseconds(6900)) {
    bench.cycle();
    if (bench.now < since + milliseconds(2000)) {
      bench.deliver(CanFrame::make(0x182, {0x17, 0x02, 0, 0, 0, 0}));
    }
    ASSERT_EQ(bench.controlword(0x202), 0x0002);
  }
  EXPECT_TRUE(bench.run_until([&] { return bench.controlword(0x202) == 0; }, milliseconds(300)));
}

TEST(Cia402Intruder, AfterAResetASecondSourceIsFoundAgain) {
  Bench bench;
  bench.drive({1.0, 0.0});
  for (int i = 0; i < 3; ++i) {
    bench.cycle();
    bench.deliver(standing_right());
  }
  bench.run(milliseconds(6000));
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  bench.run(milliseconds(2000));
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  for (int i = 0; i < 3; ++i) {
    bench.cycle();
    bench.deliver(CanFrame::make(0x182, {0x50, 0x02, 0, 0, 0, 0}));
  }
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
}

TEST(Cia402Intruder, FeedbackThatDrivesSendWhenTheyLikeMayComeAnyNumberOfTimes) {
  Cia402Config config = test::two_nodes();
  for (PdoConfig& pdo : config.pdos) {
    if (pdo.transmit) pdo.transmission = 255;
  }
  Bench bench(config);
  bench.drive({1.0, 0.0});
  for (int i = 0; i < 10; ++i) {
    bench.cycle();
    bench.deliver(standing_right());
  }
  EXPECT_EQ(bench.phase(), DrivePhase::enabled);
  EXPECT_EQ(bench.profile.counters().surplus_feedback, 0);
}

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

TEST(Cia402Intruder, AToolThatWritesObjectsIsReportedUntilTheNextReset) {
  Bench bench;
  bench.to_standby();
  bench.deliver(CanFrame::make(0x602, {0x2B, 0x00, 0x21, 0, 0x64, 0, 0, 0}));
  bench.deliver(CanFrame::make(0x602, {0x2B, 0x00, 0x21, 0, 0x64, 0, 0, 0}));
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
