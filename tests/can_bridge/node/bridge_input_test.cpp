#include <gtest/gtest.h>

#include <memory>
#include <tether/autonomy_state_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <vector>

#include "can_bridge/node/can_bridge_node.hpp"
#include "common/base/errors.hpp"
#include "tests/can_bridge/node/bridge_fakes.hpp"
#include "tests/support/virtual_world.hpp"

// The bridge and the vehicle's safety inputs.
namespace tether {
namespace {

using test::at_ms;
using test::FakePort;
using test::FakeProfile;
using test::Seen;
using test::VirtualWorld;

struct BridgeInputs : ::testing::Test {
  VirtualWorld world;
  FakePort port;
  FakeProfile* profile = nullptr;                // the node's
  std::vector<CanFilter> own{CanFilter{0x181}};  // the drivetrain's
  std::unique_ptr<CanBridgeNode> node;
  std::vector<Seen<drivetrain_state_t>> states;

  void start(std::uint32_t id, const Scenario& scenario = Scenario()) {
    DrivetrainConfig config = test::drivetrain();
    SafetyInputConfig input;
    input.name = "field";
    input.wiring = SafetyInputConfig::Can{.id = id, .clear = 0xFF};
    std::get<Cia402Config>(config).safety_inputs = {input};
    world.collect("CAN/STATE", states);
    auto owned = std::make_unique<FakeProfile>();
    owned->own = own;
    profile = owned.get();
    node = std::make_unique<CanBridgeNode>(scenario, config, world.loop, world.bus, port,
                                           std::move(owned));
  }
  std::string reason_at(int ms) {
    world.loop.run_until(at_ms(ms));
    return states.back().message.reason;
  }
};

TEST_F(BridgeInputs, AreHeardFromTheirFirstFrameOnAndNotByTheProfile) {
  start(0x3A0);
  port.frame_handler(CanFrame::make(0x3A0, {0xFF}));  // before the first cycle
  EXPECT_EQ(reason_at(90), "ready to be armed");
  EXPECT_EQ(reason_at(100),
            "safety input field: no frame 0x3A0 for 100 ms: check its supply and plug");
  port.frame_handler(CanFrame::make(0x3A0, {0x00}));
  EXPECT_EQ(reason_at(120), "safety input field demands a stop");
  EXPECT_TRUE(profile->heard.empty());
}

TEST_F(BridgeInputs, AreTheSupervisorsReportsToAVehicleThatDrivesItself) {
  Scenario scenario;
  scenario.get<AutonomySettings>().enabled = true;
  start(0x3A0, scenario);
  port.frame_handler(CanFrame::make(0x3A0, {0xFF}));
  EXPECT_EQ(reason_at(40), "autonomy: not heard yet");
  autonomy_state_t report{};
  report.utime = to_utime(at_ms(50));
  report.clear_m = 5.0;
  world.publish_at(at_ms(50), "AGV/AUTONOMY", report);
  EXPECT_EQ(reason_at(80), "ready to be armed");
}

TEST_F(BridgeInputs, AFrameOfTheDrivetrainItselfIsRefused) {
  EXPECT_THROW(start(0x181), UsageError);
}

TEST_F(BridgeInputs, AFrameOf29BitsIsAnotherThanTheInputsOf11) {
  own = {{.id = 0x1234'53A0, .mask = 0x7FF, .extended = true}};
  start(0x3A0);
  port.frame_handler(CanFrame::make(0x3A0, {0xFF}));
  EXPECT_EQ(reason_at(40), "ready to be armed");
}

}  // namespace
}  // namespace tether
