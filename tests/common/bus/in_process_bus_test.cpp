#include "common/node/in_process_bus.hpp"

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "common/node/channel_names.hpp"
#include "common/node/virtual_loop.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::IsEmpty;

struct InProcessBusTest : testing::Test {
  void publish(const std::string& channel, const std::string& text) {
    bus.publish(channel, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  /// Notes "<who>: <channel> <text>" for every message.
  void listen(const std::string& who, const std::string& channels) {
    bus.subscribe(channels, 1, [this, who](const Message& m) {
      log.push_back(who + ": " + std::string(m.channel) + " " +
                    std::string(m.bytes.begin(), m.bytes.end()));
    });
  }
  void deliver() { loop.run_until(loop.now()); }

  VirtualLoop loop;
  InProcessBus bus{loop};
  std::vector<std::string> log;
};

TEST_F(InProcessBusTest, DeliversInOrderOfPublicationThenOfSubscription) {
  listen("a", "X");
  listen("b", "X");
  publish("X", "1");
  publish("X", "2");
  deliver();
  EXPECT_THAT(log, ElementsAre("a: X 1", "b: X 1", "a: X 2", "b: X 2"));
}

TEST_F(InProcessBusTest, DeliversNothingWhilePublishing) {
  listen("a", "X");
  publish("X", "1");
  EXPECT_THAT(log, IsEmpty());
  deliver();
  EXPECT_THAT(log, ElementsAre("a: X 1"));
}

TEST_F(InProcessBusTest, DeliversAtTheInstantOfPublicationBeforeNodesAndAfterPhysics) {
  listen("a", "X");
  const Instant t = kStart + 5ms;
  loop.at(t, Priority::node, [this](Instant) { log.push_back("node"); });
  loop.at(t, Priority::physics, [this](Instant) {
    publish("X", "1");
    log.push_back("physics");
  });
  loop.run_until(t);
  EXPECT_THAT(log, ElementsAre("physics", "a: X 1", "node"));
}

TEST_F(InProcessBusTest, AMessagePublishedInAHandlerComesLaterNotInside) {
  bus.subscribe("PING", 1, [this](const Message&) {
    log.push_back("ping begins");
    publish("PONG", "!");
    log.push_back("ping ends");
  });
  listen("a", "PING|PONG");
  publish("PING", "?");
  deliver();
  EXPECT_THAT(log, ElementsAre("ping begins", "ping ends", "a: PING ?", "a: PONG !"));
}

TEST_F(InProcessBusTest, AChannelPatternMustMatchTheWholeName) {
  listen("part", "POSE");
  listen("side", "AGV/.*");
  listen("dot", "AGV.POSE");
  listen("either", "AGV|POSE");
  publish("AGV/POSE", "1");
  publish("CTRL/POSE", "2");
  publish("AGV/POSE/X", "3");
  deliver();
  EXPECT_THAT(log, ElementsAre("side: AGV/POSE 1", "dot: AGV/POSE 1", "side: AGV/POSE/X 3"));
}

TEST_F(InProcessBusTest, BytesAreCopiedWhenPublished) {
  listen("a", "X");
  std::string text = "before";
  publish("X", text);
  text = "after!";
  deliver();
  EXPECT_THAT(log, ElementsAre("a: X before"));
}

TEST_F(InProcessBusTest, AMessageMayBeEmptyOrHoldZeroBytes) {
  listen("a", "X");
  publish("X", "");
  publish("X", std::string("a\0b", 3));
  deliver();
  EXPECT_THAT(log, ElementsAre("a: X ", std::string("a: X a\0b", 8)));
}

TEST_F(InProcessBusTest, HoldsAnyNumberOfMessagesWhateverTheCapacity) {
  int received = 0;
  bus.subscribe("X", 1, [&received](const Message&) { ++received; });
  for (int i = 0; i < 10'000; ++i) publish("X", "m");
  deliver();
  EXPECT_EQ(received, 10'000);
}

TEST_F(InProcessBusTest, ALaterSubscriptionHearsAChannelThatWasUsedBefore) {
  publish("X", "to no subscriber");
  listen("a", "X");
  publish("X", "to a");
  deliver();
  EXPECT_THAT(log, ElementsAre("a: X to a"));
}

TEST(ChannelNames, TellTheSideOfTheNetwork) {
  const ChannelNames usual("AGV");
  EXPECT_EQ(usual.vehicle_pose, "AGV/POSE");
  EXPECT_EQ(usual.control_pose, "CTRL/POSE");
  EXPECT_EQ(usual.control_command, "CTRL/CMD_VEL");
  EXPECT_EQ(usual.vehicle_command, "AGV/CMD_VEL");

  const ChannelNames seventh("AGV7");
  EXPECT_EQ(seventh.vehicle_pose, "AGV7/POSE");
  EXPECT_EQ(seventh.control_pose, "CTRL7/POSE");

  const ChannelNames other("forklift");
  EXPECT_EQ(other.vehicle_command, "forklift/CMD_VEL");
  EXPECT_EQ(other.control_command, "CTRL-forklift/CMD_VEL");
}

}  // namespace
}  // namespace tether
