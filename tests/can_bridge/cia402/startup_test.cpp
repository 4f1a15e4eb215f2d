#include "can_bridge/cia402/startup.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

namespace tether {
namespace {

using test::Bench;
using test::milliseconds;
using test::two_nodes;

/// Text of a frame of start-up: "81" of NMT, or the SDO's bytes as far as they are used.
std::string text(const CanFrame& f) {
  std::string s = fmt::format("{:03X}#", f.id);
  for (const std::uint8_t b : f.bytes()) s += fmt::format("{:02X}", b);
  return s;
}

/// The writes, NMT commands and heartbeats of node 1's start-up, in order.
std::vector<std::string> script(const Bench& bench) {
  std::vector<std::string> lines;
  for (const CanFrame& f : bench.log) {
    const bool write = f.id == 0x601 && f.data[0] != 0x40;
    if (write || (f.id == 0 && f.data[1] == 1)) lines.push_back(text(f));
  }
  return lines;
}

TEST(Cia402Startup, ConfiguresADriveInTheOrderThatTheStandardAsksFor) {
  Bench bench;
  bench.to_standby();
  ASSERT_EQ(bench.phase(), DrivePhase::standby) << bench.reason();
  EXPECT_THAT(
      script(bench),
      ::testing::ElementsAre("000#8101", "601#23161001FA007F00", "601#2B17100064000000",
                             "601#2F29100100000000", "601#2B07600003000000", "601#2B5A600006000000",
                             "601#23856000B80B0000",
                             // RPDO1
                             "601#2300140101020080", "601#2F00160000000000", "601#2300160110004060",
                             "601#230016022000FF60", "601#2F00160002000000", "601#2F00140201000000",
                             "601#2B00140564000000", "601#2300140101020000",
                             // TPDO1
                             "601#2300180181010080", "601#2F001A0000000000", "601#23001A0110004160",
                             "601#23001A0220006C60", "601#2F001A0002000000", "601#2F00180201000000",
                             "601#2300180181010000",
                             // TPDO2
                             "601#2301180181020080", "601#2F011A0000000000", "601#23011A0120006460",
                             "601#23011A0210003F60", "601#23011A0308006160", "601#2F011A0003000000",
                             "601#2F01180201000000", "601#2301180181020000",
                             // mode of operation
                             "601#2F60600003000000", "000#0101"));
}

TEST(Cia402Startup, ReadsEveryWrittenObjectBack) {
  const Cia402Config config = two_nodes();
  std::set<std::pair<int, int>> written, read;
  for (const cia402::SdoStep& s : cia402::startup_steps(config, 1)) {
    if (s.write) written.insert({s.object.index, s.object.sub});
    if (s.check != cia402::SdoStep::Check::none) read.insert({s.read_back.index, s.read_back.sub});
  }
  written.erase({0x6060, 0});  // read back through 0x6061
  EXPECT_TRUE(std::includes(read.begin(), read.end(), written.begin(), written.end()));
  EXPECT_TRUE(read.contains({0x6061, 0}));
}

TEST(Cia402Startup, OneTransferAtATimeForEachNode) {
  Bench bench;
  bench.profile.start(bench.now);
  while (bench.phase() == DrivePhase::starting) {
    bench.cycle();
    for (const std::uint32_t id : {0x601u, 0x602u}) {
      EXPECT_LE(std::ranges::count(bench.sent, id, &CanFrame::id), 1);
    }
  }
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
}

TEST(Cia402Startup, APresetPdoIsOnlyReadBack) {
  Cia402Config config = two_nodes();
  for (PdoConfig& p : config.pdos) p.preset = true;
  for (const cia402::SdoStep& s : cia402::startup_steps(config, 1)) {
    if (s.object.index < 0x1400 || s.object.index >= 0x2000 || s.object.sub == 5) continue;
    EXPECT_FALSE(s.write) << s.object.index;
    EXPECT_EQ(s.check, cia402::SdoStep::Check::equal);
  }
}

TEST(Cia402Startup, TheDrivesHearTwoHeartbeatsAfterTheirConfigurationAndBeforeNmtStart) {
  Bench bench;
  bench.to_standby();
  int beats_since_last_sdo = 0;
  for (const CanFrame& f : bench.log) {
    if (f.id == 0x601 || f.id == 0x602) beats_since_last_sdo = 0;
    if (f == CanFrame::make(0x77F, {0x05})) ++beats_since_last_sdo;
    if (f.id == 0 && f.data[0] == 0x01) break;
  }
  EXPECT_EQ(beats_since_last_sdo, 2);
}

TEST(Cia402Startup, NoSetpointAndNoSyncLeavesBeforeNmtStart) {
  Bench bench;
  bench.profile.start(bench.now);
  while (bench.count(CanFrame::make(0, {0x01, 1})) == 0) {
    EXPECT_EQ(bench.newest(0x201), nullptr);
    EXPECT_EQ(bench.newest(0x080), nullptr);
    bench.cycle();
  }
  EXPECT_NE(bench.newest(0x201), nullptr);
  EXPECT_NE(bench.newest(0x080), nullptr);
}

TEST(Cia402Startup, EndsInStandbyWithPowerOffAndStandingWheels) {
  Bench bench;
  bench.to_standby();
  EXPECT_EQ(bench.phase(), DrivePhase::standby);
  EXPECT_EQ(bench.reason(), "");
  EXPECT_TRUE(bench.snapshot().standstill);
  EXPECT_EQ(bench.left_axis().state, canopen::DriveState::switch_on_disabled);
  EXPECT_EQ(bench.controlword(), 0x0000);
  EXPECT_EQ(bench.profile.counters().rejected_frames, 0);
  EXPECT_EQ(bench.profile.counters().intruder_frames, 0);
}

}  // namespace
}  // namespace tether
