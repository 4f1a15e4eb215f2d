#include "controller/node/controller_node.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <tether/controller_report_t.hpp>
#include <tether/counters_t.hpp>

#include "controller/laws/controller_settings.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::counter;
using test::pose;
using test::Seen;
using test::VirtualWorld;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

struct ControllerNodeTest : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<twist_t>> commands;
  std::vector<Seen<controller_report_t>> reports;
  std::vector<Seen<counters_t>> counters;
  std::unique_ptr<ControllerNode> node;

  void start() {
    world.collect("CTRL/CMD_VEL", commands);
    world.collect("CTRL/REPORT", reports);
    world.collect("CTRL/COUNTERS", counters);
    node = std::make_unique<ControllerNode>(scenario, world.loop, world.bus);
  }
  /// The node's final counters, by name.
  std::int64_t count(const std::string& name) {
    node->finish();
    world.loop.run_until(world.loop.now());
    return counter(counters.back().message, name);
  }
  void use_timer(double rate_hz) {
    scenario.get<ControllerSettings>().trigger = ControllerSettings::Trigger::timer;
    scenario.get<ControllerSettings>().rate_hz = rate_hz;
  }
};

TEST_F(ControllerNodeTest, EventTriggerSendsNothingBeforeTheFirstPose) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  world.loop.run_until(at_s(10));
  EXPECT_TRUE(commands.empty());
}

TEST_F(ControllerNodeTest, TimerTriggerSendsZeroTwistsBeforeTheFirstPose) {
  use_timer(10.0);
  start();
  world.loop.run_until(at_s(1));
  ASSERT_EQ(commands.size(), 11U);  // t = 0, 0.1 … 1.0
  for (const auto& c : commands) {
    EXPECT_EQ(c.message.v_mps, 0.0);
    EXPECT_EQ(c.message.omega_radps, 0.0);
    EXPECT_EQ(c.message.pose_utime, -1);
  }
}

TEST_F(ControllerNodeTest, OdometryIsCheckedAsPosesAreAndTriggersNothing) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  const auto odometry = [](double t_s, std::int64_t seq, double x_m = 0.0) {
    odometry_t m{};
    m.utime = to_utime(at_s(t_s));
    m.seq = seq;
    m.x_m = x_m;
    return m;
  };
  world.publish_at(at_s(1), "CTRL/ODOMETRY", odometry(0.9, 0));
  world.publish_at(at_s(2), "CTRL/ODOMETRY", odometry(1.9, 1, kNaN));
  world.publish_at(at_s(3), "CTRL/ODOMETRY", odometry(0.9, 0));
  world.publish_bytes_at(at_s(3), "CTRL/ODOMETRY", {1, 2, 3});
  world.publish_at(at_s(4), "CTRL/ODOMETRY", odometry(3.9, 2));
  world.loop.run_until(at_s(5));
  EXPECT_TRUE(commands.empty());
  EXPECT_EQ(count("odometry.accepted"), 2);
  EXPECT_EQ(count("odometry.non_finite"), 1);
  EXPECT_EQ(count("odometry.duplicated"), 1);
  EXPECT_EQ(count("odometry.undecodable"), 1);
}

TEST_F(ControllerNodeTest, EventTriggerAnswersEachPoseAtOnce) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  world.publish_at(at_s(1), "CTRL/POSE", pose(at_s(0.9), 0));
  world.publish_at(at_s(3), "CTRL/POSE", pose(at_s(2.9), 1));
  world.loop.run_until(at_s(10));
  ASSERT_EQ(commands.size(), 2U);
  EXPECT_EQ(commands[0].when, at_s(1));
  EXPECT_EQ(commands[0].message.utime, 1'000'000);
  EXPECT_EQ(commands[0].message.pose_utime, 900'000);
  EXPECT_EQ(commands[0].message.seq, 0);
  EXPECT_GT(commands[0].message.v_mps, 0.0);
  EXPECT_EQ(commands[1].when, at_s(3));
  EXPECT_EQ(commands[1].message.seq, 1);
}

TEST_F(ControllerNodeTest, ReportNamesThePoseItsAgeAndTheErrors) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  world.publish_at(at_s(1), "CTRL/POSE", pose(at_s(0.75), 41));
  world.loop.run_until(at_s(1));
  ASSERT_EQ(reports.size(), 1U);
  const controller_report_t& r = reports[0].message;
  EXPECT_EQ(r.pose_seq, 41);
  EXPECT_DOUBLE_EQ(r.pose_age_s, 0.25);
  EXPECT_GT(r.distance_error_m, 0.0);
  EXPECT_EQ(r.v_mps, commands[0].message.v_mps);
  EXPECT_FALSE(r.pose_timed_out);
}

TEST_F(ControllerNodeTest, EventTriggerStopsTheVehicleOnceWhenThePoseIsTimeoutOld) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  start();
  world.publish_at(at_s(0.4), "CTRL/POSE", pose(at_s(0.4), 0));
  world.loop.run_until(at_ms(899.999));
  EXPECT_EQ(commands.size(), 1U);
  world.loop.run_until(at_s(20));
  ASSERT_EQ(commands.size(), 2U);
  EXPECT_EQ(commands[1].when, at_ms(900));
  EXPECT_EQ(commands[1].message.v_mps, 0.0);
  EXPECT_EQ(commands[1].message.omega_radps, 0.0);
  EXPECT_TRUE(reports[1].message.pose_timed_out);
  EXPECT_EQ(count("pose.timeouts"), 1);
}

// A controller that was restarted has not stopped what the one before sent.
TEST_F(ControllerNodeTest, EventTriggerStopsTheVehicleOnceWhenNoPoseHasComeForTheTimeout) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  world.loop.run_until(at_s(7));
  start();
  world.loop.run_until(at_s(20));
  ASSERT_EQ(commands.size(), 1U);
  EXPECT_EQ(commands[0].when, at_ms(7500));
  EXPECT_EQ(commands[0].message.v_mps, 0.0);
  EXPECT_TRUE(reports[0].message.pose_timed_out);
  EXPECT_EQ(reports[0].message.pose_seq, -1);
  EXPECT_EQ(count("pose.timeouts"), 1);
}

TEST_F(ControllerNodeTest, TimerTriggerCountsATimeoutThatBeginsWithTheRun) {
  use_timer(10.0);
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  start();
  world.loop.run_until(at_s(1));
  ASSERT_EQ(reports.size(), 11U);
  EXPECT_FALSE(reports[4].message.pose_timed_out);
  EXPECT_TRUE(reports[5].message.pose_timed_out);
}

TEST_F(ControllerNodeTest, ANewPoseInTimePreventsTheTimeout) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  start();
  for (int i = 0; i < 10; ++i) {
    world.publish_at(at_ms(400.0 * i), "CTRL/POSE", pose(at_ms(400.0 * i), i));
  }
  world.loop.run_until(at_ms(400.0 * 9 + 499));
  EXPECT_EQ(commands.size(), 10U);
  EXPECT_EQ(count("pose.timeouts"), 0);
}

TEST_F(ControllerNodeTest, APoseThatArrivesTooOldIsAnsweredByAStop) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  start();
  world.publish_at(at_s(2), "CTRL/POSE", pose(at_s(1.5), 0, 5.0, 5.0));
  world.loop.run_until(at_s(5));
  ASSERT_EQ(commands.size(), 2U);  // 0.5 s without a pose, then the old one
  EXPECT_EQ(commands[1].when, at_s(2));
  EXPECT_EQ(commands[1].message.v_mps, 0.0);
  EXPECT_TRUE(reports[1].message.pose_timed_out);
}

TEST_F(ControllerNodeTest, TimerTriggerSendsZeroTwistsFromThePoseTimeoutOn) {
  use_timer(10.0);
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  start();
  world.publish_at(kStart, "CTRL/POSE", pose(kStart, 0));
  world.loop.run_until(at_s(1));
  ASSERT_EQ(commands.size(), 11U);
  EXPECT_GT(commands[4].message.v_mps, 0.0);  // t = 0.4 s
  EXPECT_EQ(commands[5].message.v_mps, 0.0);  // t = 0.5 s: exactly the timeout
  EXPECT_EQ(commands[10].message.v_mps, 0.0);
}

TEST_F(ControllerNodeTest, ZeroTimeoutMeansNever) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  use_timer(1.0);
  start();
  world.publish_at(at_s(0.5), "CTRL/POSE", pose(at_s(0.5), 0));
  world.loop.run_until(at_s(100));
  EXPECT_GT(commands.back().message.v_mps, 0.0);
  EXPECT_EQ(count("pose.timeouts"), 0);
}

TEST_F(ControllerNodeTest, NonFinitePosesAreCountedAndIgnored) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  world.publish_at(at_s(1), "CTRL/POSE", pose(at_s(1), 0, kNaN, 0.0, 0.0));
  world.publish_at(at_s(2), "CTRL/POSE", pose(at_s(2), 1, 0.0, kInf, 0.0));
  world.publish_at(at_s(3), "CTRL/POSE", pose(at_s(3), 2, 0.0, 0.0, -kInf));
  world.publish_at(at_s(3), "CTRL/POSE", pose(at_s(3), 3, 1.7e308, -1.7e308, 0.0));
  world.loop.run_until(at_s(3.5));
  EXPECT_TRUE(commands.empty());
  EXPECT_EQ(count("pose.non_finite"), 4);
  EXPECT_EQ(count("pose.accepted"), 0);
}

TEST_F(ControllerNodeTest, ANonFinitePoseDoesNotRefreshTheTimeout) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.5;
  start();
  world.publish_at(at_s(0.1), "CTRL/POSE", pose(at_s(0.1), 0));
  world.publish_at(at_s(0.5), "CTRL/POSE", pose(at_s(0.5), 1, kNaN));
  world.loop.run_until(at_s(0.7));
  ASSERT_EQ(commands.size(), 2U);
  EXPECT_EQ(commands[1].when, at_s(0.6));
}

TEST_F(ControllerNodeTest, DuplicatedReorderedAndBackwardPosesAreCountedAndIgnored) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  world.publish_at(at_s(5), "CTRL/POSE", pose(at_s(5), 5));
  world.publish_at(at_s(5.1), "CTRL/POSE", pose(at_s(5), 5));    // the same again
  world.publish_at(at_s(5.2), "CTRL/POSE", pose(at_s(4), 4));    // an older one
  world.publish_at(at_s(5.3), "CTRL/POSE", pose(at_s(4.9), 6));  // its clock went back
  world.publish_at(at_s(5.4), "CTRL/POSE", pose(at_s(60), 7));   // its clock is ahead
  world.loop.run_until(at_s(5.5));
  EXPECT_EQ(commands.size(), 1U);
  EXPECT_EQ(count("pose.accepted"), 1);
  EXPECT_EQ(count("pose.duplicated"), 1);
  EXPECT_EQ(count("pose.reordered"), 1);
  EXPECT_EQ(count("pose.time_backwards"), 1);
  EXPECT_EQ(count("pose.from_future"), 1);
}

TEST_F(ControllerNodeTest, GarbageOnThePoseChannelIsCountedAndIgnored) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  world.publish_bytes_at(at_s(1), "CTRL/POSE", {});
  world.publish_bytes_at(at_s(1), "CTRL/POSE", {1, 2, 3});
  world.publish_bytes_at(at_s(1), "CTRL/POSE", std::vector<std::uint8_t>(48, 0xff));
  world.publish_at(at_s(1), "CTRL/POSE", test::twist(at_s(1), 0, 1.0, 1.0));  // another type
  world.loop.run_until(at_s(2));
  EXPECT_TRUE(commands.empty());
  EXPECT_EQ(count("pose.undecodable"), 4);
}

TEST_F(ControllerNodeTest, CommandsStayWithinTheLimits) {
  scenario.get<ControllerSettings>().pose_timeout_s = 0.0;
  start();
  world.publish_at(at_s(1), "CTRL/POSE", pose(at_s(1), 0, 1e6, -1e6, 3.0));
  world.publish_at(at_s(2), "CTRL/POSE", pose(at_s(2), 1, -1e6, 1e6, -3.0));
  world.loop.run_until(at_s(2));
  ASSERT_EQ(commands.size(), 2U);
  for (const auto& c : commands) {
    EXPECT_LE(std::abs(c.message.v_mps), scenario.get<ControllerSettings>().v.limit);
    EXPECT_LE(std::abs(c.message.omega_radps), scenario.get<ControllerSettings>().omega.limit);
  }
}

}  // namespace
}  // namespace tether
