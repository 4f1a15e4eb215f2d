// SocketCanPort on a CAN controller with error states and a queue: a serial-line adapter.
#include <gmock/gmock.h>
#include <linux/can/error.h>

#include <chrono>
#include <optional>

#include "can_peers.hpp"
#include "socket_can_node.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using test::frame_with;
using test::Node;
using test::Peer;
using test::SerialAdapter;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Not;

/// A CAN controller.
class Controller : public testing::Test {
 protected:
  SerialAdapter adapter_{"can7"};
};

TEST_F(Controller, CarriesFramesBothWays) {
  Node node("can7");
  EXPECT_TRUE(node.port.send(CanFrame::make(0x201, {0xAA, 0xBB})));
  adapter_.receive("t20331122FF");
  ASSERT_TRUE(node.until([&] { return !node.frames.empty(); }));
  EXPECT_THAT(node.frames, ElementsAre(CanFrame::make(0x203, {0x11, 0x22, 0xFF})));
  node.run(50ms);
  EXPECT_THAT(adapter_.take(), ElementsAre("t2012AABB"));
}

TEST_F(Controller, FollowsItsErrorStates) {
  Node node("can7");
  adapter_.report('p', 128);
  ASSERT_TRUE(node.until_state(CanState::error_passive));
  EXPECT_TRUE(node.port.send(frame_with(0x201, 1)));
  adapter_.report('a', 0);
  ASSERT_TRUE(node.until_state(CanState::up));
  EXPECT_EQ(node.counter("can.error_frames_unconfirmed"), 0);
}

TEST_F(Controller, SendsNothingFromBusOffUntilTheRestart) {
  Node node("can7");
  adapter_.report('b', 256);
  ASSERT_TRUE(node.until_state(CanState::bus_off));
  for (std::uint8_t i = 0; i < 20; ++i) EXPECT_FALSE(node.port.send(frame_with(0x201, i)));
  std::string why;
  EXPECT_TRUE(node.port.restart(why)) << why;
  EXPECT_EQ(node.port.state(), CanState::up);
  EXPECT_TRUE(node.port.send(frame_with(0x201, 0x77)));
  node.run(100ms);
  EXPECT_THAT(adapter_.take(), ElementsAre("t201177"));
  EXPECT_THAT(node.states, ElementsAre(CanState::bus_off, CanState::up));
  EXPECT_EQ(node.counter("can.error_frames_unconfirmed"), 0);
}

TEST_F(Controller, IsBelievedMoreThanAForgedErrorFrame) {
  Node node("can7");
  Peer peer("can7");
  peer.send(CAN_ERR_BUSOFF | CAN_ERR_FLAG, std::vector<std::uint8_t>(8));
  ASSERT_TRUE(node.until([&] { return node.counter("can.error_frames_unconfirmed") == 1; }));
  EXPECT_EQ(node.port.state(), CanState::up);
  EXPECT_THAT(node.states, IsEmpty());
}

TEST(SocketCanPort, FollowsAnAdapterThatIsUnpluggedAndPluggedInAgain) {
  std::optional<SerialAdapter> adapter("can8");
  Node node("can8");
  adapter.reset();
  ASSERT_TRUE(node.until_state(CanState::absent));
  EXPECT_FALSE(node.port.send(frame_with(0x201, 1)));
  adapter.emplace("can8");
  ASSERT_TRUE(node.until_state(CanState::up));
  EXPECT_EQ(node.counter("can.reopened"), 1);
  EXPECT_TRUE(node.port.send(frame_with(0x201, 2)));
  node.run(100ms);
  EXPECT_THAT(adapter->take(), ElementsAre("t201102"));
}

struct Filled {
  std::uint32_t accepted = 0;  ///< frames 0x300, numbered from 0 in their data
  Instant refused_since{};
};

/// Sends until all that there is between the port and a stalled adapter is full: until nothing was
/// accepted for 300 ms.
Filled fill(Node& node) {
  Filled filled;
  filled.refused_since = node.loop.now();
  bool refused = false;
  while (!refused || node.loop.now() - filled.refused_since < 300ms) {
    const auto byte = [&](int i) { return static_cast<std::uint8_t>(filled.accepted >> (8 * i)); };
    const Instant now = node.loop.now();
    if (node.port.send(CanFrame::make(0x300, {byte(3), byte(2), byte(1), byte(0)}))) {
      ++filled.accepted;
      refused = false;
      continue;
    }
    if (!refused) filled.refused_since = now;
    refused = true;
    node.run(2ms);
  }
  return filled;
}

TEST_F(Controller, ThatStallsIsReportedOnceNothingWasTakenFor60Ms) {
  Node node("can7");
  Instant reported{};
  node.port.on_state([&](CanState s) {
    if (s == CanState::stalled) reported = node.loop.now();
  });
  adapter_.stall(true);
  const Filled filled = fill(node);
  EXPECT_EQ(node.port.state(), CanState::stalled);
  EXPECT_GT(reported - filled.refused_since, SocketCanPort::kStallTime);
  EXPECT_LT(reported - filled.refused_since, SocketCanPort::kStallTime + 100ms);
  EXPECT_GT(node.counter("can.send_dropped"), 2);
}

TEST_F(Controller, SendsNoFrameFromBeforeTheStallAfterTheRestart) {
  Node node("can7");
  adapter_.stall(true);
  const Filled filled = fill(node);
  std::string why;
  node.port.restart(why);  // a serial adapter that takes nothing cannot even be switched off
  adapter_.stall(false);
  ASSERT_TRUE(
      node.until([&] { return node.port.state() == CanState::up || node.port.restart(why); }));
  node.run(200ms);
  const auto before = adapter_.take();  // frames that the adapter itself had taken already
  ASSERT_THAT(before, Not(IsEmpty()));
  EXPECT_THAT(before, testing::Each(testing::StartsWith("t3004")));
  const auto thrown_away = filled.accepted - 1 - std::stoul(before.back().substr(5), nullptr, 16);
  EXPECT_GE(thrown_away, 3u) << "what waited in the kernel was not thrown away";
  EXPECT_LE(thrown_away, 8u) << "too much waited in the kernel";
  EXPECT_TRUE(node.port.send(frame_with(0x201, 0x55)));
  node.run(200ms);
  EXPECT_THAT(adapter_.take(), ElementsAre("t201155"));
}

TEST_F(Controller, RecoversWithoutARestartWhenTheBusTakesFramesAgain) {
  Node node("can7");
  adapter_.stall(true);
  fill(node);
  ASSERT_EQ(node.port.state(), CanState::stalled);
  adapter_.stall(false);
  ASSERT_TRUE(node.until([&] { return node.port.send(frame_with(0x201, 2)); }));
  EXPECT_EQ(node.port.state(), CanState::up);
}

TEST_F(Controller, DropsWhatDoesNotFitIntoAQueueThatOthersFilled) {
  Node node("can7");
  adapter_.stall(true);
  Peer peer("can7");
  Instant accepted = node.loop.now();
  while (node.loop.now() - accepted < 300ms) {
    if (peer.send(0x300, {0})) accepted = node.loop.now();
  }
  EXPECT_FALSE(node.port.send(frame_with(0x201, 1)));
  EXPECT_EQ(node.counter("can.send_dropped"), 1);
}

}  // namespace
}  // namespace tether
