#include <gtest/gtest.h>

#include <memory>
#include <tether/drivetrain_state_t.hpp>
#include <vector>

#include "can_bridge/node/can_bridge_node.hpp"
#include "tests/can_bridge/node/bridge_fakes.hpp"
#include "tests/support/virtual_world.hpp"

// A bridge whose own loop is late.

namespace tether {
namespace {

using test::at_ms;
using test::drivetrain;
using test::FakePort;
using test::FakeProfile;
using test::LateLoop;
using test::Seen;
using test::VirtualWorld;

struct LateCanBridgeTest : ::testing::Test {
  Scenario scenario;
  LateLoop loop;
  VirtualWorld world;
  FakePort port;
  FakeProfile* profile = nullptr;
  std::unique_ptr<CanBridgeNode> node;

  LateCanBridgeTest() {
    auto owned = std::make_unique<FakeProfile>();
    profile = owned.get();
    node = std::make_unique<CanBridgeNode>(scenario, drivetrain(), loop, world.bus, port,
                                           std::move(owned));
    loop.wake_up_at(kStart);
  }
  std::size_t cycles() const { return profile->ticks.size(); }
};

TEST_F(LateCanBridgeTest, ALateCycleOfLessThanAPeriodIsOrdinary) {
  loop.wake_up_at(at_ms(39.999999));
  EXPECT_EQ(cycles(), 2U);
}

TEST_F(LateCanBridgeTest, MissedCyclesAreNotMadeUpFor) {
  loop.wake_up_at(at_ms(40));  // 20 and 40 ms are due
  EXPECT_EQ(cycles(), 2U);
  loop.wake_up_at(at_ms(490));
  EXPECT_EQ(cycles(), 3U);
  EXPECT_EQ(port.sent.size(), 6U);
  EXPECT_EQ(profile->ticks.back(), at_ms(490));
}

TEST_F(LateCanBridgeTest, ACycleThatIsHeldUpWhileItSendsSendsNoMoreAfterItsPeriod) {
  for (const double held_up_ms : {19.999999, 20.0, 1200.0}) {
    const Instant start = loop.time = loop.time + std::chrono::seconds{2};
    port.sent.clear();
    port.on_send = [&] { loop.time = start + from_seconds(held_up_ms * 1e-3); };
    loop.task(start);
    // A heartbeat and a setpoint; the first was on its way in time.
    EXPECT_EQ(port.sent.size(), held_up_ms < 20.0 ? 2U : 1U) << held_up_ms;
  }
}

TEST_F(LateCanBridgeTest, ABridgeThatStoodStillForLongNeedsAReset) {
  std::vector<Seen<drivetrain_state_t>> states;
  world.collect("CAN/STATE", states);
  loop.wake_up_at(at_ms(700));
  world.loop.run_until(kStart);
  EXPECT_EQ(states.back().message.state, drivetrain_state_t::FAULT);
  EXPECT_NE(states.back().message.reason.find("stood still for 700 ms"), std::string::npos);
}

}  // namespace
}  // namespace tether
