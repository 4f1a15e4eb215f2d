#include "netem/relay/netem_node.hpp"

#include <gtest/gtest.h>

#include <tether/counters_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/link_report_t.hpp>

#include "common/scenario/run_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/markov.hpp"
#include "tests/support/telling_bus.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::Seen;
using test::VirtualWorld;

struct NetemNodeTest : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<link_report_t>> uplink, downlink;

  std::unique_ptr<NetemNode> start() {
    world.collect("NET/UPLINK", uplink);
    world.collect("NET/DOWNLINK", downlink);
    return std::make_unique<NetemNode>(scenario, world.loop, world.bus, world.bus);
  }
};

TEST_F(NetemNodeTest, ForwardsRawBytesBothWaysWithoutDecoding) {
  const std::vector<std::uint8_t> garbage{0xde, 0xad, 0x00};
  std::vector<std::vector<std::uint8_t>> poses, commands;
  world.bus.subscribe("CTRL/POSE", 1, [&](const Message& m) {
    poses.emplace_back(m.bytes.begin(), m.bytes.end());
  });
  world.bus.subscribe("AGV/CMD_VEL", 1, [&](const Message& m) {
    commands.emplace_back(m.bytes.begin(), m.bytes.end());
  });
  const auto node = start();
  world.publish_bytes_at(at_s(1), "AGV/POSE", garbage);
  world.publish_bytes_at(at_s(1), "CTRL/CMD_VEL", garbage);
  world.loop.run_until(at_s(1));
  EXPECT_EQ(poses, std::vector<std::vector<std::uint8_t>>{garbage});
  EXPECT_EQ(commands, std::vector<std::vector<std::uint8_t>>{garbage});
}

TEST_F(NetemNodeTest, RelaysNothingOfAChannelWhileTwoProgramsSendOnIt) {
  test::TellingBus telling(world.bus, test::sender_by_number);
  std::vector<Seen<twist_t>> commands;
  std::vector<Seen<pose_t>> poses;
  std::vector<Seen<counters_t>> counters;
  world.collect("AGV/CMD_VEL", commands);
  world.collect("CTRL/POSE", poses);
  world.collect("NET/COUNTERS", counters);
  NetemNode node(scenario, world.loop, telling, telling);
  for (int ms = 0; ms < 6000; ms += 50) {
    world.publish_at(at_ms(ms), "CTRL/CMD_VEL", test::twist(at_ms(ms), ms / 50, 0.0, 0.0));
    world.publish_at(at_ms(ms), "AGV/POSE", test::pose(at_ms(ms), ms / 50));
    if (ms >= 1000 && ms < 2000) {
      world.publish_at(at_ms(ms + 10), "CTRL/CMD_VEL", test::twist(at_ms(ms), 1000, 9.0, 0.0));
    }
  }
  world.loop.run_until(at_s(6));
  node.finish();
  world.loop.run_until(at_s(6));
  EXPECT_EQ(poses.size(), 120U);
  std::int64_t others = 0, refused = 120 + 20;
  for (const Seen<twist_t>& command : commands) {
    others += command.message.v_mps == 9.0 ? 1 : 0;
    refused -= 1;
    const bool silent = command.when > at_ms(1150) && command.when < at_ms(3900);
    EXPECT_FALSE(silent) << to_seconds(command.when);
  }
  EXPECT_LE(others, 3) << "until they are known to be two";
  EXPECT_EQ(test::counter(counters.back().message, "senders.refused"), refused);
  EXPECT_EQ(test::counter(counters.back().message, "senders.several"), 1);
}

TEST_F(NetemNodeTest, PlansShareTheDownlinkWithCommandsAndPayForTheirSize) {
  scenario = parse_scenario("", "test.toml",
                            {"channel.downlink.rate.bits_per_s=8e3"});  // a byte a millisecond
  std::vector<Instant> commands, plans;
  world.bus.subscribe("AGV/CMD_VEL", kDeepQueue,
                      [&](const Message&) { commands.push_back(world.loop.now()); });
  world.bus.subscribe("AGV/PLAN", kDeepQueue,
                      [&](const Message&) { plans.push_back(world.loop.now()); });
  const auto node = start();
  world.publish_bytes_at(at_s(1), "CTRL/PLAN", std::vector<std::uint8_t>(900));
  world.publish_bytes_at(at_s(1), "CTRL/CMD_VEL", std::vector<std::uint8_t>(10));
  world.loop.run_until(at_s(3));
  EXPECT_EQ(plans, std::vector<Instant>{at_s(1.9)});
  EXPECT_EQ(commands, std::vector<Instant>{at_s(1.91)});
  EXPECT_EQ(node->downlink().counters().offered, 2);
}

TEST_F(NetemNodeTest, APreloadPassesByTheLinksAndIsCounted) {
  scenario.get<ChannelSettings>().downlink.fixed = {0.0, 1000.0};  // nothing gets through
  std::vector<Seen<counters_t>> counters;
  world.collect("NET/COUNTERS", counters);
  std::vector<Instant> preloads;
  world.bus.subscribe("AGV/PRELOAD", kDeepQueue,
                      [&](const Message&) { preloads.push_back(world.loop.now()); });
  const auto node = start();
  world.publish_bytes_at(at_s(1.5), "CTRL/PRELOAD", {1, 2, 3});
  world.publish_bytes_at(at_s(1.5), "CTRL/PLAN", {1, 2, 3});
  world.loop.run_until(at_s(2));
  node->finish();
  world.loop.run_until(at_s(2));
  EXPECT_EQ(preloads, std::vector<Instant>{at_s(1.5)});
  EXPECT_EQ(node->downlink().counters().offered, 1);
  EXPECT_EQ(test::counter(counters.front().message, "preloads"), -1);  // none, no line
  EXPECT_EQ(test::counter(counters.back().message, "preloads"), 1);
}

TEST_F(NetemNodeTest, DeliversAfterTheDelayToTheNanosecond) {
  scenario.get<ChannelSettings>().uplink.fixed.delay_ms = 333.25;
  std::vector<Seen<pose_t>> seen;
  world.collect("CTRL/POSE", seen);
  const auto node = start();
  world.publish_at(at_s(2), "AGV/POSE", test::pose(at_s(2), 0));
  world.loop.run_until(at_s(5));
  ASSERT_EQ(seen.size(), 1U);
  EXPECT_EQ(seen[0].when, at_s(2) + std::chrono::microseconds{333250});
}

TEST_F(NetemNodeTest, ReportsCountDelayAndState) {
  scenario.get<ChannelSettings>().uplink.fixed = {0.5, 100.0};
  const auto node = start();
  for (int i = 0; i < 200; ++i) {
    world.publish_at(at_ms(10.0 * i), "AGV/POSE", test::pose(at_ms(10.0 * i), i));
  }
  world.loop.run_until(at_s(4));
  node->finish();
  world.loop.run_until(at_s(4));
  const link_report_t& r = uplink.back().message;
  EXPECT_EQ(r.link, "uplink");
  EXPECT_EQ(r.offered, 200);
  EXPECT_EQ(r.offered, r.lost + r.overflowed + r.delivered + r.in_flight);
  EXPECT_GT(r.lost, 0);
  EXPECT_EQ(r.state_prr, 0.5);
  EXPECT_DOUBLE_EQ(r.delay_ms_mean, 100.0);
  EXPECT_DOUBLE_EQ(r.delay_ms_p99, 100.0);
  EXPECT_EQ(downlink.back().message.offered, 0);
}

TEST_F(NetemNodeTest, ReportsEveryPeriodAndAtEachChangeOfState) {
  scenario.get<RunSettings>().report_period_s = 1.0;
  scenario.get<ChannelSettings>().uplink.model = "markov";
  scenario.get<ChannelSettings>().uplink.own.get<MarkovConfig>().mean_good_s = 1.5;
  scenario.get<ChannelSettings>().uplink.own.get<MarkovConfig>().mean_bad_s = 0.5;
  const auto node = start();
  world.loop.run_until(at_s(100));
  EXPECT_EQ(downlink.size(), 101U);  // t = 0, 1 … 100
  std::size_t changes = 0;
  for (std::size_t i = 1; i < uplink.size(); ++i) {
    changes += uplink[i].message.state != uplink[i - 1].message.state ? 1 : 0;
  }
  EXPECT_GT(changes, 50U);  // 100 expected
  EXPECT_EQ(uplink.size(), 101U + changes);
}

TEST_F(NetemNodeTest, FeedsAMapWithThePositionBeforeThePoseIsSent) {
  scenario = parse_scenario("", "test.toml",
                            {"channel.uplink.model=map", "world.half_extent_m=2000",
                             "channel.uplink.map.access_points=[[0, 0]]"});
  const auto node = start();
  for (int i = 0; i < 200; ++i) {  // far away in every second
    const double x_m = i % 2 == 0 ? 1.0 : 1000.0;
    world.publish_at(at_s(i), "AGV/POSE", test::pose(at_s(i), i, x_m));
  }
  world.publish_bytes_at(at_s(200), "AGV/POSE", {1, 2, 3});
  world.loop.run_until(at_s(201));
  EXPECT_EQ(node->uplink().counters().offered, 201);
  EXPECT_NEAR(static_cast<double>(node->uplink().counters().lost), 100.0, 5.0);
}

// The map of a radio is that of the vehicle, wherever its poses are made.
TEST_F(NetemNodeTest, FeedsAMapWithTheTruthIfPosesAreMadeBehindTheNetwork) {
  scenario = parse_scenario(
      "", "test.toml",
      {"localiser.place=edge", "sensor.odometry_rate_hz=20", "lidar.model=sick_nanoscan3",
       "channel.uplink.model=map", "channel.uplink.map.access_points=[[0, 0]]",
       "channel.uplink.map.shadowing_sd_db=0"});
  const auto node = start();
  ground_truth_t truth{};
  publish(world.bus, "SIM/TRUTH", truth);
  world.loop.run_until(at_ms(10));
  const double near = node->uplink().process().condition().prr;
  truth.x_m = 5000.0;
  publish(world.bus, "SIM/TRUTH", truth);
  world.loop.run_until(at_ms(20));
  EXPECT_LT(node->uplink().process().condition().prr, near);
}

TEST_F(NetemNodeTest, DeliversCopiesAtTheirOwnTime) {
  scenario = parse_scenario("", "test.toml",
                            {"channel.uplink.duplicate.probability=1",
                             "channel.uplink.rate.bits_per_s=8e3"});  // a byte a millisecond
  std::vector<Instant> arrivals;
  world.bus.subscribe("CTRL/POSE", kDeepQueue,
                      [&](const Message&) { arrivals.push_back(world.loop.now()); });
  const auto node = start();
  world.publish_bytes_at(at_s(1), "AGV/POSE", std::vector<std::uint8_t>(10));
  world.loop.run_until(at_s(2));
  node->finish();
  world.loop.run_until(at_s(2));
  EXPECT_EQ(arrivals, (std::vector<Instant>{at_s(1.01), at_s(1.02)}));
  const link_report_t& r = uplink.back().message;
  EXPECT_EQ(r.offered, 2);
  EXPECT_EQ(r.offered, r.lost + r.overflowed + r.delivered + r.in_flight);
}

TEST_F(NetemNodeTest, JoinsTwoNetworks) {
  InProcessBus control_bus{world.loop};
  world.collect("NET/UPLINK", uplink);
  int on_control_side = 0, on_vehicle_side = 0;
  control_bus.subscribe("CTRL/POSE", 1, [&](const Message&) { ++on_control_side; });
  world.bus.subscribe("CTRL/POSE", 1, [&](const Message&) { ++on_vehicle_side; });
  NetemNode node(scenario, world.loop, world.bus, control_bus);
  int preloads = 0;
  world.bus.subscribe("AGV/PRELOAD", 1, [&](const Message&) { ++preloads; });
  world.publish_at(at_s(1), "AGV/POSE", test::pose(at_s(1), 0));
  world.loop.at(at_s(1), Priority::node, [&](Instant) {
    control_bus.publish("CTRL/PRELOAD", std::vector<std::uint8_t>{1, 2, 3});
  });
  world.loop.run_until(at_s(2));
  EXPECT_EQ(preloads, 1);
  EXPECT_EQ(on_control_side, 1);
  EXPECT_EQ(on_vehicle_side, 0);
}

}  // namespace
}  // namespace tether
