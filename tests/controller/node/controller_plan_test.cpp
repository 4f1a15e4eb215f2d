#include <gtest/gtest.h>

#include <tether/controller_report_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/plan_t.hpp>

#include "common/scenario/run_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/node/controller_node.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::pose;
using test::Seen;
using test::VirtualWorld;

/// The controller node with laws whose output is a plan.
struct ControllerPlanTest : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<plan_t>> plans, preloads;
  std::vector<Seen<twist_t>> commands;
  std::vector<Seen<controller_report_t>> reports;
  std::unique_ptr<ControllerNode> node;

  ControllerPlanTest() {
    scenario.get<ControllerSettings>().law = "predictive_consistent";
    scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  }
  void start(std::optional<std::int64_t> session = std::nullopt) {
    world.collect("CTRL/PLAN", plans);
    world.collect("CTRL/PRELOAD", preloads);
    world.collect("CTRL/CMD_VEL", commands);
    world.collect("CTRL/REPORT", reports);
    node = std::make_unique<ControllerNode>(scenario, world.loop, world.bus, session);
  }
  void use_timer(double rate_hz) {
    scenario.get<ControllerSettings>().trigger = ControllerSettings::Trigger::timer;
    scenario.get<ControllerSettings>().rate_hz = rate_hz;
  }
};

TEST_F(ControllerPlanTest, EachPoseIsAnsweredByAPlanAndAReportAndNoTwist) {
  start(99);
  world.publish_at(at_s(1), "CTRL/POSE", pose(at_s(1), 0));
  world.loop.run_until(at_s(2));
  ASSERT_EQ(plans.size(), 1U);
  const plan_t& m = plans[0].message;
  EXPECT_EQ(m.session, 99);
  EXPECT_EQ(m.id, 0);
  EXPECT_EQ(m.seq, 0);
  EXPECT_EQ(m.based_on, -1);
  EXPECT_EQ(m.pose_utime, 1'000'000);
  EXPECT_EQ(m.start_utime, 1'000'000);
  EXPECT_EQ(m.step_us, 50'000);
  EXPECT_EQ(m.count, 400);
  EXPECT_TRUE(commands.empty());
  ASSERT_EQ(reports.size(), 1U);
  EXPECT_GT(reports[0].message.distance_error_m, 2.0);
  EXPECT_FLOAT_EQ(static_cast<float>(reports[0].message.v_mps), m.v_mps[0]);
}

TEST_F(ControllerPlanTest, TimerTriggerPlansBeforeTheFirstPose) {
  use_timer(10.0);
  start();
  world.loop.run_until(at_s(1));
  ASSERT_EQ(plans.size(), 11U);
  EXPECT_EQ(plans[3].message.id, 3);
  EXPECT_EQ(plans[3].message.start_utime, 300'000);
  EXPECT_EQ(plans[3].message.pose_utime, -1);
}

TEST_F(ControllerPlanTest, PlansOfTheLeadBeginWithThePath) {
  use_timer(1.0);
  scenario.get<RunSettings>().lead_s = 3.0;
  VirtualLoop early(at_s(-3));
  InProcessBus bus(early);
  std::vector<std::int64_t> starts;
  std::int64_t undecodable = 0;
  subscribe<plan_t>(bus, "CTRL/PLAN", kDeepQueue, undecodable,
                    [&](const plan_t& m) { starts.push_back(m.start_utime); });
  ControllerNode early_node(scenario, early, bus);
  early.run_until(at_s(1));
  EXPECT_EQ(starts, (std::vector<std::int64_t>{0, 0, 0, 0, 1'000'000}));
}

TEST_F(ControllerPlanTest, PosesOfThisSessionAloneNameAPlanToBaseOn) {
  start(5);
  world.publish_at(at_s(1), "CTRL/POSE", pose(at_s(1), 0));
  for (const std::int64_t session : {5, 6}) {
    pose_t m = pose(at_s(static_cast<double>(session)), session);
    m.plan_session = session;
    m.plan_id = 0;
    world.publish_at(at_s(static_cast<double>(session)), "CTRL/POSE", m);
  }
  world.loop.run_until(at_s(7));
  ASSERT_EQ(plans.size(), 3U);
  EXPECT_EQ(plans[1].message.based_on, 0);
  EXPECT_EQ(plans[2].message.based_on, -1);
}

TEST_F(ControllerPlanTest, SessionsComeFromTheSeed) {
  start();
  world.publish_at(at_s(1), "CTRL/POSE", pose(at_s(1), 0));
  scenario.get<RunSettings>().seed = 2;
  std::vector<Seen<plan_t>> first = plans;
  ControllerNode other(scenario, world.loop, world.bus);
  world.loop.run_until(at_s(1));
  ASSERT_EQ(plans.size(), 2U);
  EXPECT_GE(plans[0].message.session, 0);
  EXPECT_NE(plans[0].message.session, plans[1].message.session);
}

TEST_F(ControllerPlanTest, APoseTimeoutIsAnsweredByAPlanToStop) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  start();
  world.publish_at(at_s(0.4), "CTRL/POSE", pose(at_s(0.4), 0));
  world.loop.run_until(at_s(3));
  ASSERT_EQ(plans.size(), 2U);
  EXPECT_EQ(plans[1].when, at_ms(900));
  EXPECT_EQ(plans[1].message.count, 1);
  EXPECT_EQ(plans[1].message.v_mps[0], 0.0F);
  EXPECT_EQ(plans[1].message.based_on, -2);
  EXPECT_TRUE(reports[1].message.pose_timed_out);
}

TEST_F(ControllerPlanTest, PlansFromTheKnownStartEndAtTheTimeout) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  use_timer(10.0);
  start();
  world.loop.run_until(at_s(1));
  ASSERT_EQ(plans.size(), 11U);
  EXPECT_GT(plans[4].message.count, 1);
  EXPECT_EQ(plans[5].message.count, 1);
  EXPECT_EQ(plans[5].message.v_mps[0], 0.0F);
  EXPECT_EQ(plans[10].message.count, 1);
}

TEST_F(ControllerPlanTest, OfAnUnknownStartPlansStopUntilThereIsAPose) {
  scenario.get<LocaliserSettings>().place = LocaliserSettings::Place::vehicle;
  scenario.get<LocaliserSettings>().knows_start = false;
  use_timer(10.0);
  start();
  world.publish_at(at_s(0.25), "CTRL/POSE", pose(at_s(0.25), 0));
  world.loop.run_until(at_s(1));
  ASSERT_EQ(plans.size(), 11U);
  for (std::size_t i = 0; i < plans.size(); ++i) {
    EXPECT_EQ(plans[i].message.count > 1, i > 2) << i;
  }
  EXPECT_FALSE(reports[0].message.pose_timed_out);
}

// The vehicle is not at its start any more.
TEST_F(ControllerPlanTest, ARestartedControllerStopsTheVehicleUntilThereIsAPose) {
  use_timer(1.0);
  world.loop.run_until(at_s(20.5));
  start();
  world.publish_at(at_s(22.5), "CTRL/POSE", pose(at_s(22.5), 0));
  world.loop.run_until(at_s(23.5));
  ASSERT_EQ(plans.size(), 3U);
  EXPECT_EQ(plans[0].message.count, 1);
  EXPECT_EQ(plans[1].message.count, 1);
  EXPECT_GT(plans[2].message.count, 1);
}

TEST_F(ControllerPlanTest, ThePreloadedPlanIsThereBeforeAllElse) {
  use_timer(1.0);
  scenario.get<ControllerSettings>().preload = true;
  start();
  world.loop.run_until(kStart);
  ASSERT_EQ(preloads.size(), 1U);
  EXPECT_EQ(preloads[0].message.id, 0);
  EXPECT_EQ(preloads[0].message.start_utime, 0);
  ASSERT_EQ(plans.size(), 1U);
  EXPECT_EQ(plans[0].message.id, 1);
  EXPECT_EQ(plans[0].message.based_on, 0);
}

TEST_F(ControllerPlanTest, WithoutTheKeyNothingIsPreloaded) {
  use_timer(1.0);
  start();
  world.loop.run_until(at_s(1));
  EXPECT_TRUE(preloads.empty());
}

}  // namespace
}  // namespace tether
