#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/can_bridge/node/bridge_rig.hpp"
#include "tests/support/folder.hpp"

// The bridge's e-stop file, from the bridge's side.
namespace tether {
namespace {

namespace fs = std::filesystem;
using test::at_ms;
using test::at_s;

struct BridgeEstop : test::BridgeRig {
  test::Folder folder;
  fs::path path = folder.path / "estop";

  void start_remembering() {
    start();
    node->use_estop_file(EstopFile(path));
  }
  /// Released and reset, from 0.1 s on.
  void release() {
    request_at(at_ms(50), drive_request_t::ESTOP_RELEASE);
    request_at(at_ms(70), drive_request_t::RESET);
    world.loop.run_until(at_ms(200));
  }
  void end() {
    world.loop.every(world.loop.now(), std::chrono::milliseconds{10}, Priority::node,
                     [this](Instant) { node->wind_down(); });
    world.loop.run_until(world.loop.now() + std::chrono::seconds{25});
  }
};

TEST_F(BridgeEstop, WithoutProofOfACleanEndTheBridgeStartsWithTheEstopPressed) {
  start_remembering();
  world.loop.run_until(at_ms(40));
  EXPECT_EQ(state().state, drivetrain_state_t::ESTOP);
  EXPECT_THAT(state().reason, ::testing::HasSubstr("did not exist"));
  release();
  EXPECT_EQ(state().state, drivetrain_state_t::DISARMED);
}

TEST_F(BridgeEstop, AnEndInGoodOrderIsProven) {
  start_remembering();
  release();
  EXPECT_THAT(test::contents(path), ::testing::StartsWith("tether e-stop record: in use"));
  end();
  EXPECT_FALSE(EstopFile(path).latched());
}

TEST_F(BridgeEstop, AnEndWithWheelsThatTurnIsNotProven) {
  start_remembering();
  release();
  profile->now.standstill = false;
  profile->now.wheels[0].speed_radps = 1.0;
  end();
  EXPECT_TRUE(EstopFile(path).latched());
}

TEST_F(BridgeEstop, ALatchIsRememberedInItsCycle) {
  start_remembering();
  release();
  request_at(at_ms(210), drive_request_t::ESTOP);
  world.loop.run_until(at_ms(220));
  EXPECT_THAT(test::contents(path), ::testing::StartsWith("tether e-stop record: latched"));
}

TEST_F(BridgeEstop, ADeletedFileIsReportedWithinTwoCycles) {
  start_remembering();
  release();
  fs::remove(path);
  world.loop.run_until(at_ms(240));
  EXPECT_THAT(state().reason, ::testing::HasSubstr("was deleted"));
}

}  // namespace
}  // namespace tether
