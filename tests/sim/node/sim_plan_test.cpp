#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <tether/counters_t.hpp>
#include <tether/plan_in_force_t.hpp>
#include <tether/pose_t.hpp>
#include <vector>

#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/common/actuator/plan_rig.hpp"
#include "tests/support/virtual_world.hpp"

// Plans at the simulated vehicle: executed by time, named in poses, counted.

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::counter;
using test::plan;
using test::Seen;
using test::to_message;
using test::twist;
using test::VirtualWorld;

class SimPlan : public ::testing::TestWithParam<VehicleSettings::Plant> {
 protected:
  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<pose_t>> poses;
  std::vector<Seen<counters_t>> counters;
  std::unique_ptr<SimNode> node;

  void start() {
    scenario.get<ActuatorSettings>().policy = "horizon";
    scenario.get<VehicleSettings>().plant = GetParam();
    world.collect("AGV/POSE", poses);
    world.collect("SIM/COUNTERS", counters);
    node = std::make_unique<SimNode>(scenario, world.loop, world.bus);
  }
  void send_at(Instant when, const Plan& plan, const char* channel = "AGV/PLAN") {
    world.publish_at(when, channel, to_message(plan));
  }
  /// The plan in the newest pose that was stamped by then.
  std::int64_t plan_in_pose(Instant by) const {
    std::int64_t id = -9;
    for (const auto& [when, m] : poses) {
      if (from_utime(m.utime) <= by) id = m.plan_id;
    }
    return id;
  }
  std::int64_t count(const std::string& name) {
    node->finish();
    world.loop.run_until(world.loop.now());
    return counter(counters.back().message, name);
  }
  double speed_mps() const { return node->vehicle().state().twist.v_mps; }
};

TEST_P(SimPlan, IsExecutedByTimeAndEndsWithARampToStandstill) {
  start();
  send_at(at_s(1), plan(at_s(2), 0, Plan::kBasedOnNone, {0.6, 0.0}, 20));
  world.loop.run_until(at_s(2));
  EXPECT_NEAR(speed_mps(), 0.0, 1e-3) << "it waits for its start";
  world.loop.run_until(at_s(3.98));
  EXPECT_NEAR(speed_mps(), 0.6, 0.01);
  world.loop.run_until(at_s(4.2));  // 0.6 m/s at 1.5 m/s²: from 4.0 to 4.4 s
  EXPECT_NEAR(speed_mps(), 0.3, 0.05);
  world.loop.run_until(at_s(5));
  EXPECT_NEAR(speed_mps(), 0.0, 5e-3);
  EXPECT_EQ(count("plan.accepted"), 1);
}

TEST_P(SimPlan, PosesNameThePlanThatIsAcceptedByTheirStamp) {
  scenario.get<SensorSettings>().rate_hz = 100.0;
  start();
  send_at(at_ms(1005), plan(at_s(1), 0, Plan::kBasedOnNone));
  send_at(at_ms(1200), plan(at_ms(1100), 1, 0));  // at the very time of a pose
  send_at(at_ms(1300), plan(at_ms(1200), 2, 0));  // refused
  world.publish_at(at_ms(1505), "AGV/CMD_VEL", twist(at_ms(1505), 0, 0.0, 0.0));
  world.loop.run_until(at_s(2));
  EXPECT_EQ(poses.front().message.plan_session, -1);
  EXPECT_EQ(plan_in_pose(at_ms(1000)), -1);
  EXPECT_EQ(plan_in_pose(at_ms(1010)), 0);
  EXPECT_EQ(plan_in_pose(at_ms(1190)), 0);
  EXPECT_EQ(plan_in_pose(at_ms(1210)), 1);
  EXPECT_EQ(plan_in_pose(at_ms(1500)), 1);
  EXPECT_EQ(plan_in_pose(at_ms(1510)), -1) << "a twist ends them all";
  for (const auto& [when, m] : poses) EXPECT_EQ(m.plan_session, m.plan_id < 0 ? -1 : 7);
}

TEST_P(SimPlan, ALatentSensorNamesThePlanOfTheMeasurement) {
  scenario.get<SensorSettings>().rate_hz = 10.0;
  scenario.get<SensorSettings>().latency_ms = 80.0;
  start();
  send_at(at_ms(1050), plan(at_s(1), 0, Plan::kBasedOnNone));
  world.loop.run_until(at_s(2));
  EXPECT_EQ(plan_in_pose(at_ms(1000)), -1) << "sent at 1080 ms";
  EXPECT_EQ(plan_in_pose(at_ms(1100)), 0);
}

TEST_P(SimPlan, APreloadIsOnBoardBeforeDeparture) {
  start();
  Plan p = plan(at_s(30), 0, Plan::kBasedOnNone, {0.5, 0.0}, 30);
  p.stamp = at_s(1);
  send_at(at_s(1), p);  // too far ahead for the network
  send_at(at_s(2), p, "AGV/PRELOAD");
  world.loop.run_until(at_s(30));
  EXPECT_EQ(plan_in_pose(at_s(1.9)), -1);
  EXPECT_EQ(plan_in_pose(at_s(2.1)), 0);
  EXPECT_NEAR(speed_mps(), 0.0, 1e-3);
  world.loop.run_until(at_s(31));
  EXPECT_NEAR(speed_mps(), 0.5, 0.01);
  EXPECT_EQ(count("plan.too_early"), 1);
}

TEST_P(SimPlan, EveryMessageOnThePlanChannelIsCountedOnce) {
  start();
  std::mt19937 random(3);
  constexpr int kMessages = 2000;
  for (int i = 0; i < kMessages; ++i) {
    const Instant now = at_ms(5.0 * i);
    Plan p = plan(now, i);
    p.based_on = p.based_on_last = random() % 2 == 0 ? Plan::kBasedOnAny : i - 1;
    const plan_t m = to_message(p);
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(m.getEncodedSize()));
    m.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    for (auto n = random() % 4; n > 0; --n) {  // the first 96 bytes are all but the twists
      const std::size_t k = random() % 100;
      const bool is_session = k >= 32 && k < 40;  // one that is made up shuts out the others
      if (!is_session) bytes[k] ^= static_cast<std::uint8_t>(1U << random() % 8);
    }
    if (random() % 50 == 0) bytes.resize(random() % bytes.size());
    world.publish_bytes_at(now, random() % 9 == 0 ? "AGV/PRELOAD" : "AGV/PLAN", bytes);
  }
  world.loop.run_until(at_s(10));
  const std::int64_t undecodable = count("plan.undecodable");
  EXPECT_EQ(count("plan.received") + undecodable + count("plan.other_run"), kMessages);
  EXPECT_GT(undecodable, 50);
  EXPECT_GT(count("plan.accepted"), 100);
  std::int64_t sum = 0;
  const counters_t& m = counters.back().message;
  for (std::size_t i = 0; i < m.name.size(); ++i) {
    const std::string& name = m.name[i];
    const bool is_fate = name.starts_with("plan.") && name != "plan.received" &&
                         name != "plan.missed" && name != "plan.sessions" &&
                         name != "plan.other_run" && name != "plan.undecodable";
    sum += is_fate ? m.value[i] : 0;
  }
  EXPECT_EQ(sum, count("plan.received"));
  EXPECT_TRUE(is_usable(node->vehicle().state().pose));
}

TEST_P(SimPlan, WithDrivesOnCanThePoseNamesWhatTheBridgeTells) {
  scenario.get<VehicleSettings>().drivetrain = VehicleSettings::Drivetrain::can;
  scenario.get<SensorSettings>().rate_hz = 100.0;
  start();
  send_at(at_ms(10), plan(at_ms(10), 5));  // the bridge's business
  plan_in_force_t m{};
  m.utime = to_utime(at_ms(105));
  m.session = 7;
  m.id = 3;
  world.publish_at(at_ms(105), "CAN/PLAN", m);
  m.id = 4;
  world.publish_at(at_ms(155), "CAN/PLAN", m);  // duplicated
  m.seq = 1;
  m.utime = to_utime(at_ms(205));
  m.session = m.id = -1;
  world.publish_at(at_ms(205), "CAN/PLAN", m);
  world.loop.run_until(at_ms(300));
  EXPECT_EQ(plan_in_pose(at_ms(100)), -1);
  EXPECT_EQ(plan_in_pose(at_ms(110)), 3);
  EXPECT_EQ(plan_in_pose(at_ms(200)), 3);
  EXPECT_EQ(plan_in_pose(at_ms(210)), -1);
  EXPECT_EQ(count("plan_in_force.duplicated"), 1);
  EXPECT_EQ(count("plan.accepted"), -1) << "no such counter here";
}

INSTANTIATE_TEST_SUITE_P(Plants, SimPlan,
                         ::testing::Values(VehicleSettings::Plant::ode,
                                           VehicleSettings::Plant::kinematic),
                         [](const auto& info) {
                           return std::string(
                               info.param == VehicleSettings::Plant::ode ? "ode" : "kinematic");
                         });

}  // namespace
}  // namespace tether
