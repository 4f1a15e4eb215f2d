#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/commission/trials.hpp"
#include "tests/can_bridge/node/bridge_rig.hpp"
#include "tests/support/source_dir.hpp"

// The bridge arms only what was commissioned.
namespace tether {
namespace {

using test::at_ms;
using test::at_s;

struct BridgeCommission : test::BridgeRig {
  Cia402Config drives =
      std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/two_node_cia402.toml")));
};

TEST_F(BridgeCommission, WithoutARecordNothingIsArmed) {
  start();
  node->use_commission_guard({drives, 0.4, std::nullopt, "there is none"});
  steer(1.0, 0.5);
  world.loop.run_until(at_s(1));
  EXPECT_EQ(state().state, drivetrain_state_t::DISARMED);
  EXPECT_THAT(state().reason,
              ::testing::HasSubstr("arming refused: not commissioned: there is none"));
  EXPECT_EQ(fastest_sent_mmps(), 0);
}

TEST_F(BridgeCommission, InStandbyTheDrivesAreAsked) {
  CommissionRecord record;
  record.settings = commissioned_settings(drives, 0.4);
  for (const char* drive : {"left drive (node 1)", "right drive (node 2)"}) {
    for (const Trial trial : kTrials)
      record.results.push_back({drive, trial_name(trial), "ok", ""});
  }
  start();
  node->use_commission_guard({drives, 0.4, record, ""});
  world.loop.run_until(at_ms(100));
  const auto asked = std::ranges::count_if(port.sent, [](const CanFrame& frame) {
    return frame.id == canopen::kSdoRequest + 1 || frame.id == canopen::kSdoRequest + 2;
  });
  EXPECT_GT(asked, 0);
  EXPECT_THAT(state().reason, ::testing::HasSubstr("being compared"));
}

}  // namespace
}  // namespace tether
