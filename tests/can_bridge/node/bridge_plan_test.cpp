#include "tests/can_bridge/node/bridge_rig.hpp"

// Plans, and messages of another run.

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::counter;
using test::drivetrain;
using test::FakePort;
using test::FakeProfile;
using test::Seen;
using test::setpoint_mmps;
using test::twist;
using test::VirtualWorld;

using CanBridgePlanTest = test::BridgeRig;

TEST_F(CanBridgePlanTest, CommandsPlansAndRequestsOfAnotherRunMoveNothingButStopsStop) {
  scenario.get<ActuatorSettings>().policy = "horizon";
  start();
  steer(2.0, 0.8);
  twist_t command = twist(at_ms(1010), 1000, 1.6, 0.0);
  command.run = 1;
  world.publish_at(at_ms(1010), "AGV/CMD_VEL", command);
  plan_t plan = test::to_message(test::plan(at_ms(1010), 4, Plan::kBasedOnAny, {}));
  plan.run = 1;
  world.publish_at(at_ms(1010), "AGV/PLAN", plan);
  drive_request_t request{};
  request.run = 1;
  request.utime = 1'020'000;
  request.seq = 1000;
  request.request = drive_request_t::RESET;
  world.publish_at(at_ms(1020), "CAN/REQUEST", request);
  world.loop.run_until(at_ms(1045));
  EXPECT_EQ(state().state, drivetrain_state_t::ARMED);
  EXPECT_LE(fastest_sent_mmps(), 800);
  EXPECT_EQ(count("command.other_run"), 1);
  EXPECT_EQ(count("plan.other_run"), 1);
  EXPECT_EQ(count("request.other_run"), 1);
  request.request = drive_request_t::ESTOP;
  world.publish_at(at_ms(1050), "CAN/REQUEST", request);
  world.loop.run_until(at_ms(1070));
  EXPECT_NE(state().state, drivetrain_state_t::ARMED);
}

TEST_F(CanBridgePlanTest,
       TwoProgramsThatCommandAreAFaultEvenIfTheLatersMessagesAllCountAsReordered) {
  start();
  steer(2.0, 0.8);  // numbers from 0 on
  for (int ms = 1000; ms < 1300; ms += 50) {
    world.publish_at(at_ms(ms + 10), "AGV/CMD_VEL", twist(at_ms(ms - 60), 1000, 0.0, 0.0));
  }
  world.loop.run_until(at_ms(1105));
  EXPECT_EQ(state().state, drivetrain_state_t::ARMED);
  world.loop.run_until(at_ms(1185));
  EXPECT_NE(state().state, drivetrain_state_t::ARMED);
  EXPECT_EQ(state().reason.find("two programs command this vehicle, on AGV/CMD_VEL: 127.0.0.1:256 "
                                "and 127.0.0.1:257: leave one of them, then reset"),
            0U)
      << state().reason;
  EXPECT_EQ(count("senders.several"), 1);
}

TEST_F(CanBridgePlanTest, TellsEveryCycleWhichPlanItFollows) {
  scenario.get<ActuatorSettings>().policy = "horizon";
  std::vector<Seen<plan_in_force_t>> plans;
  world.collect("CAN/PLAN", plans);
  start();
  Plan p = test::plan(at_ms(30), 4, Plan::kBasedOnNone, {});
  world.publish_at(at_ms(30), "AGV/PLAN", test::to_message(p));
  p.name.id = p.seq = 5;
  p.based_on = p.based_on_last = 4;
  world.publish_at(at_ms(70), "AGV/PRELOAD", test::to_message(p));
  world.publish_bytes_at(at_ms(75), "AGV/PLAN", {1, 2, 3});
  world.loop.run_until(at_ms(100));
  ASSERT_EQ(plans.size(), 6U);
  const std::vector<std::int64_t> ids{-1, -1, 4, 4, 5, 5};
  for (std::size_t i = 0; i < ids.size(); ++i) {
    EXPECT_EQ(plans[i].message.id, ids[i]) << i;
    EXPECT_EQ(plans[i].message.session, ids[i] < 0 ? -1 : 7) << i;
    EXPECT_EQ(plans[i].message.seq, static_cast<std::int64_t>(i));
    EXPECT_EQ(plans[i].message.utime, to_utime(plans[i].when));
  }
  EXPECT_EQ(count("plan.accepted"), 2);
  EXPECT_EQ(count("plan.undecodable"), 1);
}

TEST_F(CanBridgePlanTest, WithoutThePolicyItNeitherFollowsPlansNorTells) {
  std::vector<Seen<plan_in_force_t>> plans;
  world.collect("CAN/PLAN", plans);
  start();
  EXPECT_EQ(count("plan.unasked"), -1);
  world.publish_at(at_ms(30), "AGV/PLAN", test::to_message(test::plan(at_ms(30), 4)));
  world.loop.run_until(at_ms(100));
  EXPECT_TRUE(plans.empty());
  EXPECT_EQ(state().command_age_s, -1.0);
  EXPECT_EQ(count("plan.unasked"), 1);
}

}  // namespace
}  // namespace tether
