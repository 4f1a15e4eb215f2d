#include <gtest/gtest.h>

#include <tether/counters_t.hpp>
#include <tether/odometry_t.hpp>

#include "netem/relay/netem_node.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::Seen;
using test::VirtualWorld;

struct RelayedOdometry {
  std::vector<Seen<pose_t>> poses;
  std::vector<Seen<odometry_t>> odometry;
  std::int64_t offered = 0;
};

/// 60 s of poses at 10 Hz and, if wanted, of odometry 7 ms behind each.
RelayedOdometry relayed(const std::vector<std::string>& channel, bool with_odometry) {
  const Scenario scenario = parse_scenario("", "test.toml", channel);
  VirtualWorld world;
  RelayedOdometry out;
  std::vector<Seen<counters_t>> counters;
  world.collect("CTRL/POSE", out.poses);
  world.collect("CTRL/ODOMETRY", out.odometry);
  world.collect("NET/COUNTERS", counters);
  NetemNode node(scenario, world.loop, world.bus, world.bus);
  for (int i = 0; i < 600; ++i) {
    world.publish_at(at_ms(100 * i), "AGV/POSE", test::pose(at_ms(100 * i), i));
    odometry_t m{};
    m.seq = i;
    if (with_odometry) world.publish_at(at_ms(100 * i + 7), "AGV/ODOMETRY", m);
  }
  world.loop.run_until(at_s(70));
  node.finish();
  world.loop.run_until(at_s(70));
  out.offered = test::counter(counters.back().message, "odometry.offered");
  return out;
}

std::vector<std::int64_t> numbers(const std::vector<Seen<pose_t>>& poses) {
  std::vector<std::int64_t> out;
  for (const auto& p : poses) out.push_back(p.message.seq);
  return out;
}

class OdometryBesidePoses : public ::testing::TestWithParam<std::vector<std::string>> {};

TEST_P(OdometryBesidePoses, LeavesTheirFateAlone) {
  const RelayedOdometry with = relayed(GetParam(), true), without = relayed(GetParam(), false);
  EXPECT_EQ(numbers(with.poses), numbers(without.poses));
  EXPECT_EQ(with.offered, 600);
  EXPECT_EQ(without.offered, -1) << "no counter either";
  EXPECT_FALSE(with.odometry.empty());
  EXPECT_LT(with.odometry.size(), 600U);
}

INSTANTIATE_TEST_SUITE_P(Channels, OdometryBesidePoses,
                         ::testing::Values(std::vector<std::string>{"channel.prr=0.5"},
                                           std::vector<std::string>{"channel.model=markov",
                                                                    "channel.markov.mean_good_s=2",
                                                                    "channel.markov.mean_bad_s=1"},
                                           std::vector<std::string>{
                                               "channel.model=gilbert_elliott",
                                               "channel.gilbert_elliott.p=0.1",
                                               "channel.gilbert_elliott.r=0.3"}));

TEST(RelayedOdometry, HasLuckOfItsOwn) {
  const RelayedOdometry r = relayed({"channel.prr=0.5"}, true);
  // Both got through: 600 · 0.25 = 150 ± 10.6, where poses and odometry are independent.
  std::vector<bool> posed(600);
  for (const auto& p : r.poses) posed[static_cast<std::size_t>(p.message.seq)] = true;
  int both = 0;
  for (const auto& m : r.odometry) both += posed[static_cast<std::size_t>(m.message.seq)] ? 1 : 0;
  EXPECT_NEAR(both, 150, 4 * 10.6);
}

TEST(RelayedOdometry, MeetsTheStateThatThePosesMeet) {
  const RelayedOdometry r = relayed(
      {"channel.model=markov", "channel.markov.mean_good_s=5", "channel.markov.mean_bad_s=5",
       "channel.markov.good.prr=1", "channel.markov.bad.prr=0"},
      true);
  std::vector<bool> posed(600), told(600);
  for (const auto& p : r.poses) posed[static_cast<std::size_t>(p.message.seq)] = true;
  for (const auto& m : r.odometry) told[static_cast<std::size_t>(m.message.seq)] = true;
  int differ = 0;
  for (std::size_t i = 0; i < posed.size(); ++i) differ += posed[i] != told[i] ? 1 : 0;
  // Only where the state changed in the 7 ms between them: 12 changes a minute, 0.84 of 600.
  EXPECT_LE(differ, 5);
  EXPECT_LT(r.poses.size(), 600U);
}

TEST(RelayedOdometry, FollowsChangesOfTheUplinksSettings) {
  const RelayedOdometry r =
      relayed({"channel.change=[{at_s=30, set=['uplink.delay_ms=40', 'uplink.loss=1']}]"}, true);
  EXPECT_EQ(r.odometry.size(), 300U);
  EXPECT_LT(r.odometry.back().when, at_s(30));
}

}  // namespace
}  // namespace tether
