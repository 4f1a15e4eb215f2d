#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tests/can_bridge/cia402/bench.hpp"

// The configuration of start-up is read back before drives are enabled, and no other sender may
// write it.
namespace tether {
namespace {

using test::Bench;
using test::milliseconds;
using ::testing::HasSubstr;

/// Objects of node 1 that were read, as index << 8 | subindex.
std::multiset<int> reads(const Bench& bench) {
  std::multiset<int> objects;
  for (const CanFrame& f : bench.log) {
    if (f.id == 0x601 && f.data[0] == 0x40) {
      objects.insert((f.data[1] | f.data[2] << 8) << 8 | f.data[3]);
    }
  }
  return objects;
}

TEST(Cia402Verify, EachWatchdogSetupAndPdoObjectIsReadOnceBeforeAnythingIsSwitchedOn) {
  Bench bench;
  bench.to_standby();
  bench.log.clear();
  bench.profile.enable();
  ASSERT_TRUE(bench.run_until([&] { return bench.controlword() == 0x0006; }));
  EXPECT_EQ(reads(bench),
            (std::multiset<int>{0x101601, 0x101700, 0x102901, 0x600700, 0x605A00, 0x608500,  //
                                0x140001, 0x140002, 0x140005, 0x160000, 0x160001, 0x160002,  //
                                0x180001, 0x180002, 0x1A0000, 0x1A0001, 0x1A0002,            //
                                0x180101, 0x180102, 0x1A0100, 0x1A0101, 0x1A0102, 0x1A0103}));
  // One a cycle, and nothing is written meanwhile.
  for (const CanFrame& f : bench.log) {
    if (f.id == 0x601 || f.id == 0x602) {
      EXPECT_EQ(f.data[0], 0x40);
    }
  }
}

struct Changed {
  test::FakeDrive::Key object;
  std::int64_t value;
  const char* reason;
};
struct EachObject : ::testing::TestWithParam<Changed> {};

TEST_P(EachObject, ThatReadsOtherwiseIsAFaultAndTheDrivesStayOff) {
  Bench bench;
  bench.to_standby();
  const auto [object, value, reason] = GetParam();
  bench.right().set_object(object.first, object.second, value);
  bench.profile.enable();
  ASSERT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(1000)));
  EXPECT_EQ(bench.reason(),
            fmt::format("right drive (node 2): {} before it was to be enabled: "
                        "another tool changed it? Reset configures the drives again",
                        reason));
  for (const CanFrame& f : bench.log) {
    if (f.id == 0x201 || f.id == 0x202) {
      EXPECT_EQ(f.data[0] & 0x0D, 0) << "only quick stop or off";
    }
  }
  bench.profile.reset_fault();
  ASSERT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
  EXPECT_NE(bench.right().object(object.first, object.second), value);
  bench.profile.enable();
  EXPECT_TRUE(bench.reach(DrivePhase::enabled, milliseconds(1500))) << bench.reason();
}

INSTANTIATE_TEST_SUITE_P(
    Cia402Verify, EachObject,
    ::testing::Values(
        Changed{{0x1016, 1}, 0, "0x1016:1 (heartbeat consumer) reads 0x0 instead of 0x7F00FA"},
        Changed{{0x6007, 0}, 0, "0x6007:0 (abort connection option) reads 0 instead of 3"},
        Changed{{0x6085, 0}, 1, "0x6085:0 (quick stop deceleration) reads 0x1 instead of 0xBB8"},
        Changed{{0x1400, 5}, 0, "0x1400:5 (RPDO1 deadline) reads 0 instead of 100"},
        Changed{{0x1A01, 2},
                0x60410010,
                "0x1A01:2 (TPDO2 mapping) reads 0x60410010 instead of 0x603F0010"}));

TEST(Cia402Verify, AnObjectThatTheDriveDoesNotHaveIsNotAskedForAgain) {
  Bench bench;
  bench.left().aborts[{0x6007, 0}] = 0x06020000;  // optional
  bench.to_standby();
  ASSERT_EQ(bench.profile.notes().size(), 1u);
  bench.log.clear();
  bench.profile.enable();
  ASSERT_TRUE(bench.reach(DrivePhase::enabled, milliseconds(1500))) << bench.reason();
  EXPECT_EQ(reads(bench).count(0x600700), 0u);
}

TEST(Cia402Verify, ADriveThatDoesNotAnswerOrAbortsIsAFault) {
  Bench mute;
  mute.to_standby();
  mute.left().unanswered = {0x605A, 0};
  mute.profile.enable();
  ASSERT_TRUE(mute.reach(DrivePhase::faulted, milliseconds(2500)));  // three tries of 500 ms
  EXPECT_THAT(mute.reason(), HasSubstr("no answer to reading 0x605A:0 (quick stop option)"));

  Bench aborting;
  aborting.to_standby();
  aborting.left().aborts[{0x605A, 0}] = 0x06020000;
  aborting.profile.enable();
  ASSERT_TRUE(aborting.reach(DrivePhase::faulted, milliseconds(1500)));
  EXPECT_THAT(aborting.reason(), HasSubstr("reading 0x605A:0 (quick stop option) aborted: "));
}

TEST(Cia402Verify, AStopMeanwhileLeadsBackToStandby) {
  Bench bench;
  bench.to_standby();
  bench.profile.enable();
  bench.run(milliseconds(100));
  bench.profile.stop(StopKind::quick);
  EXPECT_TRUE(bench.reach(DrivePhase::standby, milliseconds(200)));
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
}

TEST(Cia402Verify, FeedbackThatStopsMeanwhileIsAFault) {
  Bench bench;
  bench.to_standby();
  bench.profile.enable();
  bench.cycle();
  bench.left().send_feedback = false;
  EXPECT_TRUE(bench.reach(DrivePhase::faulted, milliseconds(140)));
}

// ---------------------------------------------------------------------------- others' writes

struct VitalWrite : ::testing::TestWithParam<std::uint16_t> {};

TEST_P(VitalWrite, OfAnotherStopsTheVehicleAndResetConfiguresTheDrivesAgain) {
  const std::uint16_t index = GetParam();
  for (const std::uint8_t command : {0x23, 0x2F, 0x21, 0xC2}) {  // expedited, segmented, block
    Bench bench;
    bench.drive({1.0, 0.0});
    const int resets = bench.left().resets;
    bench.deliver(CanFrame::make(0x601, {command, static_cast<std::uint8_t>(index & 0xFF),
                                         static_cast<std::uint8_t>(index >> 8), 0x01, 0, 0, 0, 0}));
    EXPECT_EQ(bench.reason(),
              fmt::format("left drive (node 1): another sender writes 0x{:04X}:1 by SDO: only one "
                          "master may configure; reset configures the drives again",
                          index));
    EXPECT_EQ(bench.profile.counters().intruder_writes, 1);
    // The stop does not rely on what was written.
    const bool quick_stop_is_doubtful = index == 0x605A || index == 0x605E || index == 0x6085;
    test::expect_left_stops_and_stays_stopped(bench, quick_stop_is_doubtful ? 0x000F : 0x0002);
    bench.profile.reset_fault();
    EXPECT_TRUE(bench.reach(DrivePhase::standby)) << bench.reason();
    EXPECT_EQ(bench.left().resets, resets + 1);
  }
}

INSTANTIATE_TEST_SUITE_P(Cia402Intruder, VitalWrite,
                         ::testing::Values(0x1016, 0x1017, 0x1029, 0x1400, 0x1603, 0x1800, 0x1A01,
                                           0x6007, 0x605A, 0x6085, 0x6040, 0x6060, 0x60FF,
                                           // Objects that no file configures, but stops depend on:
                                           0x605E, 0x6084, 0x607E, 0x608F, 0x6091, 0x6092));

TEST(Cia402Intruder, AVitalWriteIsAFaultWhateverTheLengthOfItsFrame) {
  for (std::uint8_t size = 4; size < 8; ++size) {
    Bench bench;
    bench.drive({1.0, 0.0});
    CanFrame write = CanFrame::make(0x601, {0x2F, 0x7E, 0x60, 0x00, 0xC0, 0, 0, 0});
    write.size = size;
    bench.deliver(write);
    EXPECT_EQ(bench.phase(), DrivePhase::faulted) << int{size};
    EXPECT_EQ(bench.profile.counters().intruder_writes, 1);
  }
}

TEST(Cia402Intruder, AfterAWriteToPdoParametersTheStopGoesBySdo) {
  Bench bench;
  bench.drive({1.0, 0.0});
  bench.log.clear();
  bench.deliver(CanFrame::make(0x601, {0x23, 0x00, 0x16, 0x01, 0, 0, 0, 0}));
  bench.cycle();
  EXPECT_EQ(bench.newest(0x602), nullptr) << "the other drive was not written to";
  ASSERT_NE(bench.newest(0x601), nullptr);
  EXPECT_EQ(*bench.newest(0x601), CanFrame::make(0x601, {0x2B, 0x40, 0x60, 0, 0x02, 0, 0, 0}));
}

TEST(Cia402Intruder, AVitalWriteDuringConfigurationIsAFaultAndBeforeItIsNot) {
  const CanFrame write = CanFrame::make(0x602, {0x23, 0x16, 0x10, 0x01, 0, 0, 0, 0});
  Bench early;
  early.profile.start(early.now);
  early.cycle();
  early.deliver(write);
  EXPECT_TRUE(early.reach(DrivePhase::standby)) << "it is overwritten";

  Bench late;
  late.profile.start(late.now);
  ASSERT_TRUE(late.run_until([&] { return late.left().resets > 0; }));
  late.run(milliseconds(100));
  late.deliver(write);
  EXPECT_EQ(late.phase(), DrivePhase::faulted);
}

}  // namespace
}  // namespace tether
