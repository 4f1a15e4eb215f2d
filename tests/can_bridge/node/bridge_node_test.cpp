#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tether/counters_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/odometry_t.hpp>
#include <tether/plan_in_force_t.hpp>
#include <tether/wheel_feedback_t.hpp>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/node/can_bridge_node.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tests/can_bridge/node/bridge_rig.hpp"
#include "tests/common/actuator/plan_rig.hpp"
#include "tests/support/virtual_world.hpp"

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

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

using CanBridgeNodeTest = test::BridgeRig;

TEST_F(CanBridgeNodeTest, SendsAndReportsOnceACycleFromTheStartOn) {
  start();
  world.loop.run_until(at_ms(100));
  EXPECT_EQ(profile->starts, std::vector<Instant>{kStart});
  EXPECT_EQ(profile->ticks.size(), 6U);  // t = 0, 20 … 100 ms
  EXPECT_EQ(port.sent.size(), 12U);
  ASSERT_EQ(states.size(), 6U);
  EXPECT_EQ(wheels.size(), 6U);
  EXPECT_EQ(odometry.size(), 6U);
  EXPECT_EQ(states[0].message.state, drivetrain_state_t::STARTING);
  EXPECT_EQ(states[5].message.state, drivetrain_state_t::DISARMED);
  EXPECT_EQ(states[5].message.state_name, "disarmed");
  EXPECT_EQ(states[5].message.seq, 5);
  EXPECT_EQ(states[5].message.utime, 100'000);
  EXPECT_EQ(states[5].message.bus, "up");
  EXPECT_EQ(states[5].message.command_age_s, -1.0);
}

TEST_F(CanBridgeNodeTest, FollowsCommandsOnceArmed) {
  start();
  steer(4.0, 0.8);
  world.loop.run_until(at_s(3.98));
  EXPECT_EQ(state().state, drivetrain_state_t::ARMED);
  EXPECT_NEAR(state().v_mps, 0.8, 1e-9);
  EXPECT_NEAR(state().command_age_s, 0.03, 1e-9);
  EXPECT_EQ(setpoint_mmps(port.sent.back()), 800);
}

TEST_F(CanBridgeNodeTest, SendsNoSetpointWithoutArming) {
  start();
  for (int i = 0; i < 100; ++i) {
    world.publish_at(at_ms(20.0 * i), "AGV/CMD_VEL", twist(at_ms(20.0 * i), i, 1.0, 0.5));
  }
  world.loop.run_until(at_s(2.0));
  EXPECT_EQ(fastest_sent_mmps(), 0);
  EXPECT_EQ(profile->command.v_mps, 0.0);
}

TEST_F(CanBridgeNodeTest, AProfileThatSendsSpeedsUnaskedIsCutOff) {
  start();
  profile->forced_mmps = 500;
  world.loop.run_until(at_s(1.0));
  EXPECT_EQ(fastest_sent_mmps(), 0);
  EXPECT_EQ(port.sent.size(), 102U) << "heartbeat and controlword still go out";
  EXPECT_EQ(count("tx.zeroed"), 51);
}

TEST_F(CanBridgeNodeTest, StopsWithin520MsOfTheLastCommand) {
  start();
  steer(3.0, 0.8);  // the last at 2.95 s
  world.loop.run_until(at_s(3.14));
  EXPECT_EQ(setpoint_mmps(port.sent.back()), 800);
  world.loop.run_until(at_s(3.16));
  EXPECT_LT(setpoint_mmps(port.sent.back()), 800);
  EXPECT_NE(state().reason.find("ramping to zero"), std::string::npos);
  world.loop.run_until(at_s(3.46));
  EXPECT_EQ(setpoint_mmps(port.sent.back()), 0);
  EXPECT_NE(state().state, drivetrain_state_t::ARMED);
  EXPECT_EQ(state().disarms, 1);
}

TEST_F(CanBridgeNodeTest, BadCommandsAreCountedAndKeepNothingAlive) {
  start();
  steer(2.0, 0.8);  // the last at 1.95 s
  for (int i = 0; i < 50; ++i) {
    const Instant t = at_s(2.0 + 0.02 * i);
    world.publish_at(t, "AGV/CMD_VEL", twist(t, 1000 + i, kNaN, 0.0));
    world.publish_bytes_at(t, "AGV/CMD_VEL", {1, 2, 3});
    world.publish_bytes_at(t, "CAN/REQUEST", {1, 2, 3});
  }
  world.loop.run_until(at_s(3.0));
  EXPECT_EQ(state().state, drivetrain_state_t::DISARMED);
  EXPECT_EQ(count("command.non_finite"), 50);
  EXPECT_EQ(count("command.undecodable"), 50);
  EXPECT_EQ(count("request.undecodable"), 50);
  EXPECT_EQ(count("disarms"), 1);
}

TEST_F(CanBridgeNodeTest, RequestsReachTheSafetyCore) {
  start();
  steer(4.0, 0.8);
  request_at(at_s(2.0), drive_request_t::ESTOP);
  world.loop.run_until(at_s(2.0));
  EXPECT_LE(std::abs(setpoint_mmps(port.sent.back())), 800);
  world.loop.run_until(at_s(2.02));
  EXPECT_EQ(setpoint_mmps(port.sent.back()), 0) << "in the next cycle at the latest";
  world.loop.run_until(at_s(2.1));
  EXPECT_EQ(state().state, drivetrain_state_t::ESTOP);
}

TEST_F(CanBridgeNodeTest, ADisarmRampsThenTellsTheDrivesToSwitchOff) {
  start();
  steer(4.0, 0.8);
  request_at(at_s(2.0), drive_request_t::DISARM);
  world.loop.run_until(at_s(3.0));
  EXPECT_EQ(profile->stops, std::vector<StopKind>{StopKind::disable});
  EXPECT_EQ(state().state, drivetrain_state_t::DISARMED);
}

TEST_F(CanBridgeNodeTest, AnEStopLeavesNoSpeedBehindInTheProfile) {
  start();
  steer(4.0, 0.8);
  request_at(at_s(2.0), drive_request_t::ESTOP);
  world.loop.run_until(at_s(1.98));
  ASSERT_NEAR(profile->command.v_mps, 0.8, 1e-9);
  world.loop.run_until(at_s(2.02));
  EXPECT_EQ(profile->stops, std::vector<StopKind>{StopKind::quick});
  EXPECT_EQ(profile->command.v_mps, 0.0);
  EXPECT_TRUE(profile->distrusted_until.empty()) << "its feedback is sound";
}

TEST_F(CanBridgeNodeTest, AResetReachesTheDrives) {
  start();
  world.loop.at(at_ms(105), Priority::node, [this](Instant) {
    profile->now.phase = DrivePhase::faulted;
    profile->now.reason = "left drive: fault";
  });
  request_at(at_ms(150), drive_request_t::RESET);
  world.loop.run_until(at_ms(140));
  EXPECT_EQ(profile->fault_resets, 0);
  world.loop.run_until(at_ms(300));
  EXPECT_EQ(profile->fault_resets, 1);
  EXPECT_EQ(state().state, drivetrain_state_t::DISARMED);
}

TEST_F(CanBridgeNodeTest, AStopForLostFeedbackTellsTheProfileHowLongNotToBelieveStandstill) {
  start();
  steer(4.0, 0.75);
  world.loop.at(at_ms(1990), Priority::node,
                [this](Instant) { profile->now.feedback_fresh = false; });
  world.loop.run_until(at_s(2.0));
  EXPECT_EQ(profile->stops, std::vector<StopKind>{StopKind::quick});
  // 0.75 m/s at 1.5 m/s², and the margin.
  ASSERT_FALSE(profile->distrusted_until.empty());
  EXPECT_EQ(profile->distrusted_until.back(), at_s(3.0));
}

TEST_F(CanBridgeNodeTest, APortThatCouldNotBeRestartedIsWarnedOfAtTheStart) {
  ::testing::internal::CaptureStderr();
  port.warned = "cannot restart can0 after a stall";
  start();
  EXPECT_EQ(::testing::internal::GetCapturedStderr(),
            "tether-can-bridge: warning: cannot restart can0 after a stall\n");
}

TEST_F(CanBridgeNodeTest, ABusThatFailsBetweenTwoCyclesLatches) {
  start();
  world.loop.at(at_ms(105), Priority::node, [this](Instant) { port.change(CanState::bus_off); });
  world.loop.at(at_ms(110), Priority::node, [this](Instant) { port.change(CanState::up); });
  world.loop.run_until(at_ms(200));
  EXPECT_EQ(state().state, drivetrain_state_t::FAULT);
  EXPECT_NE(state().reason.find("bus-off"), std::string::npos);
}

TEST_F(CanBridgeNodeTest, AResetRestartsABusThatWasOff) {
  start();
  world.loop.at(at_ms(105), Priority::node, [this](Instant) { port.change(CanState::bus_off); });
  request_at(at_ms(150), drive_request_t::RESET);
  world.loop.run_until(at_ms(140));
  EXPECT_EQ(state().bus, "bus-off");
  world.loop.run_until(at_ms(300));
  EXPECT_EQ(port.restarts, 1);
  EXPECT_EQ(state().state, drivetrain_state_t::DISARMED);
}

TEST_F(CanBridgeNodeTest, ABusThatCannotBeRestartedSaysWhatToDo) {
  start();
  port.can_restart = false;
  world.loop.at(at_ms(105), Priority::node, [this](Instant) { port.change(CanState::stalled); });
  request_at(at_ms(150), drive_request_t::RESET);
  world.loop.run_until(at_ms(300));
  EXPECT_EQ(state().state, drivetrain_state_t::FAULT);
  EXPECT_NE(state().reason.find("ip link set can0 down"), std::string::npos);
}

TEST_F(CanBridgeNodeTest, ReportsTheWheelsAndWhereTheyLed) {
  scenario.get<VehicleSettings>().start_x_m = 5.0;
  start();
  for (WheelFeedback& w : profile->now.wheels) w.valid = true;
  world.loop.at(at_ms(30), Priority::node, [this](Instant) {
    auto& [left, right] = profile->now.wheels;
    left.angle_rad = right.angle_rad = 0.5;
    left.stamp = right.stamp = at_ms(30);
    right.speed_radps = 2.0;
    left.position_counts = -7;
    right.statusword = 0x27;
    right.error_code = 0x7500;
    left.state = "OperationEnabled";
  });
  world.loop.run_until(at_ms(40));
  const wheel_feedback_t& w = wheels.back().message;
  EXPECT_TRUE(w.fresh);
  EXPECT_DOUBLE_EQ(w.left_age_s, 0.01);
  EXPECT_DOUBLE_EQ(w.right_rim_mps, 0.8);
  EXPECT_EQ(w.left_position_counts, -7);
  EXPECT_EQ(w.right_statusword, 0x27);
  EXPECT_EQ(w.right_error_code, 0x7500);
  EXPECT_EQ(w.left_state, "OperationEnabled");
  EXPECT_NEAR(odometry.back().message.x_m, 5.2, 1e-9);
  EXPECT_NEAR(odometry.back().message.distance_m, 0.2, 1e-9);
}

TEST_F(CanBridgeNodeTest, ReportsIntrudersWarningsAndTheProfilesCounters) {
  start();
  profile->seen_intruder = "0x201 from another sender";
  profile->seen_warnings = "left drive (node 1): 0x8110";
  world.loop.run_until(at_s(1.0));
  EXPECT_NE(state().reason.find("0x201 from another sender"), std::string::npos);
  EXPECT_NE(state().reason.find("; warned since the last reset: left drive (node 1): 0x8110"),
            std::string::npos);
  ASSERT_FALSE(counters.empty());
  EXPECT_EQ(counters.back().message.node, "can_bridge");
  EXPECT_EQ(count("drive.rejected_frames"), 3);
  EXPECT_EQ(count("drive.intruder_frames"), 4);
  EXPECT_EQ(count("drive.warnings"), 5);
  EXPECT_EQ(count("drive.surplus_feedback"), 5);
  EXPECT_EQ(count("can.sent"), static_cast<std::int64_t>(port.sent.size()));
}

TEST_F(CanBridgeNodeTest, FramesGoToTheProfile) {
  start();
  port.frame_handler(CanFrame::make(0x181, {1}));  // before the first cycle
  world.loop.run_until(at_ms(10));
  port.frame_handler(CanFrame::make(0x181, {2}));
  EXPECT_EQ(profile->heard, std::vector<CanFrame>{CanFrame::make(0x181, {2})});
}

TEST_F(CanBridgeNodeTest, WindsDownByStoppingThenFallsSilent) {
  start();
  steer(2.0, 0.8);
  world.loop.at(at_s(1.0), Priority::node, [this](Instant) { profile->now.standstill = false; });
  world.loop.run_until(at_s(2.0));
  ASSERT_EQ(state().state, drivetrain_state_t::ARMED);
  EXPECT_FALSE(node->wind_down());
  world.loop.run_until(at_s(2.1));
  EXPECT_EQ(setpoint_mmps(port.sent.back()), 0);
  EXPECT_EQ(profile->now.phase, DrivePhase::stopping);
  EXPECT_FALSE(node->wind_down()) << "the wheels still turn";
  profile->now.standstill = true;
  world.loop.run_until(at_s(2.2));
  EXPECT_TRUE(node->wind_down());
  EXPECT_EQ(profile->now.phase, DrivePhase::standby);
  const std::size_t sent = port.sent.size();
  world.loop.run_until(at_s(3.0));
  EXPECT_EQ(port.sent.size(), sent);
}

TEST_F(CanBridgeNodeTest, EndsWithAnErrorThatTellsTheSpeedIfTheWheelsStillTurn) {
  start();
  steer(2.0, 0.8);
  world.loop.at(at_s(1.0), Priority::node, [this](Instant) {
    profile->now.standstill = false;
    profile->now.wheels[0].speed_radps = 2.0;
  });
  world.loop.run_until(at_s(2.0));
  EXPECT_FALSE(node->wind_down());
  for (double t = 2.1; t < 5.95; t += 0.1) {
    world.loop.run_until(at_s(t));
    ASSERT_FALSE(node->wind_down()) << t;
  }
  world.loop.run_until(at_s(6.0));  // 3 m/s at 1.5 m/s², and 2 s
  EXPECT_TRUE(node->wind_down());
  try {
    node->finish();
    ADD_FAILURE() << "ended as if all were well";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("the wheels turn at 0.80 m/s, power stages on"),
              std::string::npos)
        << e.what();
  }
}

}  // namespace
}  // namespace tether
