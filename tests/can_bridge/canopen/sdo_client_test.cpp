#include "can_bridge/bus/sdo_client.hpp"

#include <gtest/gtest.h>

#include <chrono>

#include "can_bridge/bus/canopen.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using Outcome = SdoResult::Outcome;

constexpr ObjectRef kHeartbeatTime{0x1017, 0, 2, false};
constexpr ObjectRef kMode{0x6061, 0, 1, true};

Instant at(int ms) { return Instant{milliseconds(ms)}; }

struct SdoClientTest : ::testing::Test {
  SdoClient client{1, milliseconds(200), 2};
  std::vector<CanFrame> sent;

  void tick(int ms) {
    sent.clear();
    client.tick(at(ms), sent);
  }
  CanFrame reply(std::initializer_list<std::uint8_t> bytes) { return CanFrame::make(0x581, bytes); }
};

TEST_F(SdoClientTest, SendsNothingWithoutARequest) {
  tick(0);
  EXPECT_TRUE(sent.empty());
  EXPECT_FALSE(client.busy());
}

TEST_F(SdoClientTest, AWriteIsDoneWhenItsConfirmationComes) {
  client.write(kHeartbeatTime, 100);
  tick(0);
  ASSERT_EQ(sent.size(), 1u);
  EXPECT_EQ(sent[0], CanFrame::make(0x601, {0x2B, 0x17, 0x10, 0, 100, 0, 0, 0}));
  EXPECT_FALSE(client.take_result());
  EXPECT_TRUE(client.on_frame(reply({0x60, 0x17, 0x10, 0, 0, 0, 0, 0})));
  const auto result = client.take_result();
  ASSERT_TRUE(result);
  EXPECT_EQ(result->outcome, Outcome::done);
  EXPECT_FALSE(client.busy());
  tick(1000);
  EXPECT_TRUE(sent.empty());
}

TEST_F(SdoClientTest, AReadGivesTheSignedValue) {
  client.read(kMode);
  tick(0);
  EXPECT_EQ(sent.at(0), CanFrame::make(0x601, {0x40, 0x61, 0x60, 0, 0, 0, 0, 0}));
  EXPECT_TRUE(client.on_frame(reply({0x4F, 0x61, 0x60, 0, 0xFD, 0, 0, 0})));
  EXPECT_EQ(client.take_result()->value, -3);
}

TEST_F(SdoClientTest, ADriveThatAlwaysSaysFourBytesIsReadByTheObjectsOwnSize) {
  client.read(kMode);
  tick(0);
  EXPECT_TRUE(client.on_frame(reply({0x43, 0x61, 0x60, 0, 0xFD, 0xFF, 0xFF, 0xFF})));
  EXPECT_EQ(client.take_result()->value, -3);
}

TEST_F(SdoClientTest, AnAbortEndsTheTransferWithItsCode) {
  client.write(kHeartbeatTime, 100);
  tick(0);
  EXPECT_TRUE(client.on_frame(reply({0x80, 0x17, 0x10, 0, 0x00, 0x00, 0x02, 0x06})));
  const auto result = client.take_result();
  ASSERT_TRUE(result);
  EXPECT_EQ(result->outcome, Outcome::aborted);
  EXPECT_EQ(result->abort_code, 0x06020000u);
}

TEST_F(SdoClientTest, RepliesToSomethingElseChangeNothing) {
  client.write(kHeartbeatTime, 100);
  tick(0);
  EXPECT_FALSE(client.on_frame(reply({0x60, 0x18, 0x10, 0, 0, 0, 0, 0})));  // index
  EXPECT_FALSE(client.on_frame(reply({0x60, 0x17, 0x11, 0, 0, 0, 0, 0})));  // index
  EXPECT_FALSE(client.on_frame(reply({0x60, 0x17, 0x10, 1, 0, 0, 0, 0})));  // subindex
  EXPECT_FALSE(client.on_frame(reply({0x80, 0x18, 0x10, 0, 0, 0, 2, 6})));  // abort of another
  EXPECT_FALSE(client.on_frame(reply({0x4B, 0x17, 0x10, 0, 0, 0, 0, 0})));  // answer to a read
  EXPECT_FALSE(client.on_frame(reply({0x60, 0x17, 0x10, 0, 0, 0, 0})));     // 7 bytes
  EXPECT_FALSE(client.take_result());
  EXPECT_TRUE(client.busy());
}

TEST_F(SdoClientTest, AReadIsNotAnsweredByTheConfirmationOfAWrite) {
  client.read(kHeartbeatTime);
  tick(0);
  EXPECT_FALSE(client.on_frame(reply({0x60, 0x17, 0x10, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(client.take_result());
}

TEST_F(SdoClientTest, RepliesWhileNothingIsPendingAreIgnored) {
  EXPECT_TRUE(client.on_frame(reply({0x60, 0x17, 0x10, 0, 0, 0, 0, 0})));
  client.write(kHeartbeatTime, 100);  // not sent yet
  EXPECT_TRUE(client.on_frame(reply({0x60, 0x17, 0x10, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(client.take_result());
}

TEST_F(SdoClientTest, RepeatsTheRequestExactlyAtTheTimeoutAndGivesUpAfterTheRetries) {
  client.read(kHeartbeatTime);
  tick(0);
  tick(199);
  EXPECT_TRUE(sent.empty());
  tick(200);
  EXPECT_EQ(sent.size(), 1u);
  tick(399);
  EXPECT_TRUE(sent.empty());
  tick(400);
  EXPECT_EQ(sent.size(), 1u);
  tick(599);
  EXPECT_FALSE(client.take_result());
  tick(600);
  EXPECT_EQ(sent.at(0), CanFrame::make(0x601, {0x80, 0x17, 0x10, 0, 0, 0, 0x04, 0x05}));
  EXPECT_EQ(sent.size(), 1u);
  EXPECT_EQ(client.take_result()->outcome, Outcome::no_answer);
}

TEST_F(SdoClientTest, AnAnswerToARepetitionCounts) {
  client.write(kHeartbeatTime, 100);
  tick(0);
  tick(200);
  EXPECT_TRUE(client.on_frame(reply({0x60, 0x17, 0x10, 0, 0, 0, 0, 0})));
  EXPECT_EQ(client.take_result()->outcome, Outcome::done);
}

TEST_F(SdoClientTest, ASegmentedReplyIsRefusedAndAborted) {
  client.read(kHeartbeatTime);
  tick(0);
  EXPECT_TRUE(client.on_frame(reply({0x41, 0x17, 0x10, 0, 9, 0, 0, 0})));
  EXPECT_EQ(client.take_result()->outcome, Outcome::segmented);
  tick(20);
  EXPECT_EQ(sent.at(0), CanFrame::make(0x601, {0x80, 0x17, 0x10, 0, 0x01, 0, 0x04, 0x05}));
}

TEST_F(SdoClientTest, ACancelledTransferLeavesNothingBehind) {
  client.read(kHeartbeatTime);
  tick(0);
  client.cancel();
  EXPECT_FALSE(client.busy());
  tick(1000);
  EXPECT_TRUE(sent.empty());
  EXPECT_FALSE(client.take_result());
}

}  // namespace
}  // namespace tether
