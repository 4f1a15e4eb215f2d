#include <gtest/gtest.h>

#include <numbers>

#include "tests/can_bridge/emulated/drive_rig.hpp"

namespace tether {
namespace {

using canopen::NmtState;
using test::DriveRig;
using test::two_node_drivetrain;

constexpr double kNodeRpm = 2.0 * std::numbers::pi / 60.0;  // in rad/s

CanFrame emcy(std::uint16_t code, std::uint8_t error_register, std::uint8_t node = 1) {
  return CanFrame::make(
      0x080u + node, {static_cast<std::uint8_t>(code & 0xFF), static_cast<std::uint8_t>(code >> 8),
                      error_register, 0, 0, 0, 0, 0});
}

// ---------------------------------------------------------------------------- NMT

TEST(EmulatedNode, BootsIn300MsAndSaysSoOnce) {
  DriveRig rig(two_node_drivetrain());
  rig.run(299);
  EXPECT_TRUE(rig.sent().empty());
  rig.run(1);
  ASSERT_EQ(rig.sent().size(), 2u);
  EXPECT_EQ(rig.sent()[0].frame, CanFrame::make(0x701, {0x00}));
  EXPECT_EQ(rig.sent()[1].frame, CanFrame::make(0x702, {0x00}));
  EXPECT_EQ(rig.node().nmt_state(), NmtState::pre_operational);
  rig.run(1000);
  EXPECT_EQ(rig.sent().size(), 2u) << "no heartbeat unless 0x1017 asks for one";
}

TEST(EmulatedNode, HearsNothingWhileItBoots) {
  DriveRig rig(two_node_drivetrain());
  rig.run(100);
  rig.nmt(0x01);
  EXPECT_EQ(rig.write(1, 0x1017, 0, 2, 100), -1);
  rig.run(300);
  EXPECT_EQ(rig.node().nmt_state(), NmtState::pre_operational);
}

TEST(EmulatedNode, ObeysNmtForItsOwnIdAndForAll) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.nmt(0x01, 2);
  EXPECT_EQ(rig.node(0).nmt_state(), NmtState::pre_operational);
  EXPECT_EQ(rig.node(1).nmt_state(), NmtState::operational);
  rig.nmt(0x01, 0);
  EXPECT_EQ(rig.node(0).nmt_state(), NmtState::operational);
  rig.nmt(0x02, 1);
  EXPECT_EQ(rig.node(0).nmt_state(), NmtState::stopped);
  rig.nmt(0x80, 0);
  EXPECT_EQ(rig.node(0).nmt_state(), NmtState::pre_operational);
  rig.send(0x000, {0x01});
  rig.send(0x000, {0x05, 0x00});
  EXPECT_EQ(rig.node(0).nmt_state(), NmtState::pre_operational) << "short, unknown";
}

TEST(EmulatedNode, StoppedItAnswersNoSdo) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.nmt(0x02, 1);
  EXPECT_EQ(rig.abort_of_read(1, 0x1000, 0), -1) << "no answer at all";
}

TEST(EmulatedNode, SendsHeartbeatsWithItsStateAtThePeriodWritten) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.write(1, 0x1017, 0, 2, 100);
  rig.forget_sent();
  rig.run(305);
  ASSERT_EQ(rig.sent(0x701).size(), 3u);
  EXPECT_EQ(rig.sent(0x701)[0].frame.data[0], 0x7F);
  EXPECT_EQ(rig.sent(0x701)[1].when - rig.sent(0x701)[0].when, std::chrono::milliseconds{100});
  rig.nmt(0x01, 1);
  rig.run(100);
  EXPECT_EQ(rig.sent(0x701).back().frame.data[0], 0x05);
  rig.write(1, 0x1017, 0, 2, 0);
  rig.forget_sent();
  rig.run(1000);
  EXPECT_TRUE(rig.sent(0x701).empty());
}

TEST(EmulatedNode, ResetNodeForgetsEverything) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.write(1, 0x1016, 1, 4, 0x007F00FA);
  rig.write(1, 0x6083, 0, 4, 999);
  rig.write(1, 0x6040, 0, 2, 6);
  rig.run(2);
  EXPECT_EQ(rig.state(), 0x21);
  rig.forget_sent();
  rig.nmt(0x81, 1);
  rig.run(299);
  EXPECT_TRUE(rig.sent().empty());
  rig.run(1);
  EXPECT_EQ(rig.sent(0x701).size(), 1u);
  EXPECT_TRUE(rig.sent(0x702).empty());
  rig.run(20);
  EXPECT_EQ(rig.state() & 0x4F, 0x40);
  EXPECT_EQ(rig.read(1, 0x1016, 1), 0);
  EXPECT_EQ(rig.read(1, 0x6083, 0), 120);
}

TEST(EmulatedNode, ResetCommunicationForgetsOnlyCommunication) {
  DriveRig rig(two_node_drivetrain());
  rig.run(400);
  rig.write(1, 0x1017, 0, 2, 50);
  rig.write(1, 0x1400, 1, 4, 0x80000201);
  rig.write(1, 0x6083, 0, 4, 999);
  rig.nmt(0x82, 1);
  rig.forget_sent();
  rig.run(20);
  ASSERT_EQ(rig.sent(0x701).size(), 1u);
  EXPECT_EQ(rig.sent(0x701)[0].frame.data[0], 0x00);
  EXPECT_EQ(rig.read(1, 0x1017, 0), 0);
  EXPECT_EQ(rig.read(1, 0x1400, 1), 0x201);
  EXPECT_EQ(rig.read(1, 0x6083, 0), 999);
}

TEST(EmulatedNode, NmtStopWithPowerOnIsALostConnection) {
  DriveRig rig(two_node_drivetrain());
  rig.enable_by_sdo();
  rig.write(1, 0x6007, 0, 2, 2);
  rig.nmt(0x02, 1);
  rig.nmt(0x80, 1);
  rig.run(1);
  EXPECT_EQ(rig.state() & 0x4F, 0x40);
}

// ---------------------------------------------------------------------------- heartbeat consumer

/// Node 1 enabled at 60 rpm, operational, its heartbeat consumer at 250 ms.
class Heartbeats : public ::testing::Test {
 protected:
  void drive(int reaction, int nmt_reaction, bool beat = true) {
    rig_.run(400);
    rig_.write(1, 0x1016, 1, 4, 0x007F00FA);
    rig_.write(1, 0x6007, 0, 2, reaction);
    rig_.write(1, 0x1029, 1, 1, nmt_reaction);
    rig_.write(1, 0x6083, 0, 4, 6000);
    rig_.write(1, 0x6085, 0, 4, 600);
    rig_.enable_by_sdo();
    rig_.write(1, 0x60FF, 0, 4, 60);
    rig_.nmt(0x01, 1);
    rig_.run(100);
    ASSERT_NEAR(speed(), 60.0 * kNodeRpm, 1e-9);
    if (beat) rig_.heartbeat();
    rig_.forget_sent();
  }
  double speed() { return rig_.drives().wheel_targets_radps()[0]; }
  std::size_t emcys() { return rig_.sent(0x081).size(); }

  DriveRig rig_{two_node_drivetrain()};
};

TEST_F(Heartbeats, AMasterThatNeverBeatLeavesTheDriveUnguarded) {
  drive(1, 0, false);
  rig_.run(10'000);
  EXPECT_EQ(emcys(), 0u);
  EXPECT_NEAR(speed(), 60.0 * kNodeRpm, 1e-9);
}

TEST_F(Heartbeats, SilenceIsNoticedAfter250MsNotBefore) {
  drive(3, 0);
  rig_.run(249);
  EXPECT_EQ(emcys(), 0u);
  rig_.heartbeat();
  rig_.run(249);
  EXPECT_EQ(emcys(), 0u);
  rig_.run(1);
  ASSERT_EQ(emcys(), 1u);
  EXPECT_EQ(rig_.sent(0x081)[0].frame, emcy(0x8130, 0x11));
  EXPECT_EQ(rig_.node().counters().heartbeat_timeouts, 1);
  rig_.run(5000);
  EXPECT_EQ(emcys(), 1u) << "told once";
}

TEST_F(Heartbeats, OtherNodesAndOddFramesAreNoHeartbeat) {
  drive(3, 0);
  rig_.run(200);
  rig_.send(0x77E, {0x05});
  rig_.send(0x77F, {0x05, 0x00});
  rig_.send(0x77F, {0x00});
  CanFrame extended = CanFrame::make(0x77F, {0x05});
  extended.extended = true;
  rig_.send(extended);
  rig_.run(50);
  EXPECT_EQ(emcys(), 1u);
}

TEST_F(Heartbeats, Reaction3StopsOnTheQuickStopRampAndSwitchesOff) {
  drive(3, 0);
  rig_.run(250);
  rig_.run(49);
  EXPECT_NEAR(speed(), 30.0 * kNodeRpm, 0.7 * kNodeRpm);
  EXPECT_EQ(rig_.state(), 0x07);
  rig_.run(55);
  EXPECT_EQ(speed(), 0.0);
  EXPECT_EQ(rig_.state() & 0x4F, 0x40);
  EXPECT_EQ(rig_.read(1, 0x603F, 0), 0x8130);
}

TEST_F(Heartbeats, Reaction2SwitchesOffAtOnce) {
  drive(2, 0);
  rig_.run(250);
  EXPECT_EQ(speed(), 0.0);
  EXPECT_EQ(rig_.state() & 0x4F, 0x40);
}

TEST_F(Heartbeats, Reaction1IsALatchedFault) {
  drive(1, 1);
  rig_.run(360);
  EXPECT_EQ(speed(), 0.0);
  EXPECT_EQ(rig_.state() & 0x4F, 0x08);
  rig_.heartbeat();
  rig_.run(5);
  EXPECT_EQ(rig_.state() & 0x4F, 0x08) << "the heartbeat alone resets nothing";
  EXPECT_EQ(emcys(), 1u);
  rig_.write(1, 0x6040, 0, 2, 0x80);
  rig_.run(2);
  EXPECT_EQ(rig_.state() & 0x4F, 0x40);
  ASSERT_EQ(emcys(), 2u);
  EXPECT_EQ(rig_.sent(0x081)[1].frame, emcy(0, 0));
}

TEST_F(Heartbeats, Reaction0KeepsDrivingWithAWarning) {
  drive(0, 1);
  rig_.run(2000);
  EXPECT_EQ(emcys(), 1u);
  EXPECT_NEAR(speed(), 60.0 * kNodeRpm, 1e-9);
  EXPECT_EQ(rig_.read(1, 0x6041, 0) & 0x80, 0x80);
  rig_.heartbeat();
  rig_.run(2);
  EXPECT_EQ(rig_.read(1, 0x6041, 0) & 0x80, 0);
  ASSERT_EQ(emcys(), 2u);
  EXPECT_EQ(rig_.sent(0x081)[1].frame, emcy(0, 0));
}

TEST_F(Heartbeats, ADriveWithout6007TakesItForAFault) {
  Cia402Config config = two_node_drivetrain();
  config.setup.clear();
  DriveRig rig(config);
  rig.run(400);
  rig.write(1, 0x1016, 1, 4, 0x007F00FA);
  rig.heartbeat();
  rig.run(252);
  EXPECT_EQ(rig.state() & 0x4F, 0x08);
}

TEST_F(Heartbeats, TheCommunicationErrorBehaviourDecidesOnTheNmtState) {
  struct Case {
    int behaviour;
    NmtState state;
  };
  for (const Case& c : {Case{0, NmtState::pre_operational}, Case{1, NmtState::operational},
                        Case{2, NmtState::stopped}}) {
    DriveRig rig(two_node_drivetrain());
    rig.run(400);
    rig.write(1, 0x1016, 1, 4, 0x007F00FA);
    rig.write(1, 0x1029, 1, 1, c.behaviour);
    rig.nmt(0x01, 1);
    rig.heartbeat();
    rig.run(250);
    EXPECT_EQ(rig.node().nmt_state(), c.state) << c.behaviour;
    EXPECT_EQ(rig.sent(0x081).size(), 1u) << "said before it falls silent";
  }
}

TEST_F(Heartbeats, WritingTheConsumerWaitsForAFirstHeartbeatAgain) {
  drive(3, 0);
  rig_.write(1, 0x1016, 1, 4, 0x007F0064);
  rig_.run(1000);
  EXPECT_EQ(emcys(), 0u);
  rig_.heartbeat();
  rig_.run(100);
  EXPECT_EQ(emcys(), 1u);
}

TEST_F(Heartbeats, ADriveSentToPreOperationalDrivesOnAndStillWatchesItsMaster) {
  drive(3, 1);
  rig_.nmt(0x80, 0);
  EXPECT_EQ(rig_.node().nmt_state(), NmtState::pre_operational);
  rig_.send(0x201, {0x02, 0x00});  // the default RPDO1: a quick stop
  rig_.sync();
  rig_.run(200);
  EXPECT_NEAR(speed(), 60.0 * kNodeRpm, 1e-9) << "PDOs are ignored";
  EXPECT_TRUE(rig_.sent(0x181).empty());
  EXPECT_EQ(rig_.state(), 0x27) << "SDO is answered";
  rig_.run(51);
  EXPECT_EQ(rig_.state(), 0x07) << "250 ms without heartbeat: quick stop";
}

TEST_F(Heartbeats, APreOperationalDriveTakesAQuickStopBySdo) {
  drive(3, 1);
  rig_.nmt(0x80, 0);
  EXPECT_EQ(rig_.write(1, 0x6040, 0, 2, 0x02), 0);
  rig_.run(2);
  EXPECT_EQ(rig_.state(), 0x07);
  rig_.run(100);
  EXPECT_EQ(speed(), 0.0);
}

// ---------------------------------------------------------------------------- vendor watchdog

TEST(VendorWatchdog, FaultsWhenNeitherSdoNorRpdoCameInTime) {
  Cia402Config config = two_node_drivetrain();
  config.watchdogs[0] = {
      .node = 1, .kind = WatchdogConfig::Kind::milliseconds, .object = {0x2000, 0, 2, false}};
  DriveRig rig(config);
  rig.run(400);
  rig.nmt(0x01, 1);
  rig.read(1, 0x1000, 0);
  rig.run(5000);
  EXPECT_EQ(rig.sent(0x081).size(), 0u) << "off after power-on";
  rig.write(1, 0x2000, 0, 2, 200);
  rig.run(199);
  rig.send(0x201, {0x06, 0x00});  // the default RPDO1
  rig.run(199);
  EXPECT_EQ(rig.sent(0x081).size(), 0u);
  rig.heartbeat();
  rig.sync();
  rig.run(1);
  ASSERT_EQ(rig.sent(0x081).size(), 1u) << "neither heartbeat nor SYNC count";
  rig.run(2);
  EXPECT_EQ(rig.state() & 0x4F, 0x08);
  EXPECT_EQ(rig.node().counters().watchdog_timeouts, 1);
}

}  // namespace
}  // namespace tether
