#include <gtest/gtest.h>

#include <string>
#include <tether/counters_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>
#include <vector>

#include "common/node/message_io.hpp"
#include "netem/relay/netem_node.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/virtual_world.hpp"
#include "tools/nodes/closed_loop.hpp"

// The channel's models in the whole loop, in virtual time.

namespace tether {
namespace {

using test::counter;

/// Output of a link: the message's number and its way's length in ns.
using Arrivals = std::vector<std::pair<std::int64_t, std::int64_t>>;

struct LoopRun {
  /// `request`: settings that are asked for at 10 s.
  explicit LoopRun(const Scenario& scenario, const std::vector<std::string>& request = {})
      : loop(scenario) {
    if (!request.empty()) {
      loop.loop().at(kStart + std::chrono::seconds{10}, Priority::node, [=, this](Instant) {
        publish(loop.bus(), "NET/SET", setting_request(1, 1, request));
      });
    }
    collect<pose_t>("CTRL/POSE", poses);
    collect<twist_t>("AGV/CMD_VEL", commands);
    for (const char* channel : {"CTRL/COUNTERS", "SIM/COUNTERS", "CAN/COUNTERS"}) {
      subscribe<counters_t>(loop.bus(), channel, kDeepQueue, undecodable,
                            [this, channel](const counters_t& m) { counters[channel] = m; });
    }
    loop.run();
  }

  template <class LcmType>
  void collect(const std::string& channel, Arrivals& out) {
    subscribe<LcmType>(loop.bus(), channel, kDeepQueue, undecodable,
                       [this, &out](const LcmType& m) {
                         const Duration way = loop.loop().now() - from_utime(m.utime);
                         out.emplace_back(m.seq, way.count());
                       });
  }

  std::int64_t undecodable = 0;
  Arrivals poses, commands;
  std::map<std::string, counters_t> counters;
  ClosedLoop loop;
};

const std::vector<std::string> kBadNetwork{"run.duration_s=40",
                                           "sensor.rate_hz=20",
                                           "channel.uplink.model=markov",
                                           "channel.uplink.markov.mean_good_s=3",
                                           "channel.uplink.markov.mean_bad_s=1",
                                           "channel.downlink.model=gilbert_elliott",
                                           "channel.downlink.gilbert_elliott.prr=0.7",
                                           "channel.downlink.gilbert_elliott.mean_burst=5",
                                           "channel.jitter.law=gamma",
                                           "channel.jitter.mean_ms=30",
                                           "channel.jitter.sd_ms=20",
                                           "channel.loss=0.05"};

Scenario through_netem(std::vector<std::string> keys, const std::vector<std::string>& more = {}) {
  keys.insert(keys.end(), more.begin(), more.end());
  return load_scenario(in_source("/scenarios/paper.toml"), keys);
}

TEST(CommonRandomNumbers, TwoControllersMeetTheSameFates) {
  const LoopRun gentle(through_netem(kBadNetwork));
  const LoopRun harsh(through_netem(
      kBadNetwork, {"controller.v.p=2.5", "controller.omega.p=1.5", "controller.tau_s=0.5"}));
  ASSERT_NE(gentle.loop.sim().metrics().epsilon_m(), harsh.loop.sim().metrics().epsilon_m());
  EXPECT_GT(gentle.poses.size(), 100U);
  EXPECT_EQ(gentle.poses, harsh.poses);
  EXPECT_GT(gentle.commands.size(), 100U);
  EXPECT_EQ(gentle.commands, harsh.commands);
}

TEST(CommonRandomNumbers, AControllerThatSendsAtOtherTimesMeetsTheSameFatesPacketByPacket) {
  const LoopRun by_event(through_netem(kBadNetwork));
  const LoopRun by_timer(
      through_netem(kBadNetwork, {"controller.trigger=timer", "controller.rate_hz=50"}));
  EXPECT_EQ(by_event.poses, by_timer.poses);
  std::map<std::int64_t, std::int64_t> expected(by_timer.commands.begin(), by_timer.commands.end());
  for (const auto& [seq, way_ns] : by_event.commands) {
    ASSERT_TRUE(expected.contains(seq)) << "command " << seq << " arrived once and not twice";
    EXPECT_NEAR(static_cast<double>(expected[seq] - way_ns), 0.0, 1000.0);  // stamps are in us
  }
}

TEST(CommonRandomNumbers, MoreModelsDownlinkChangeNothingUplink) {
  const LoopRun plain(through_netem(kBadNetwork));
  const LoopRun more(through_netem(kBadNetwork, {"channel.downlink.duplicate.probability=0.3",
                                                 "channel.downlink.reorder.probability=0.2"}));
  EXPECT_EQ(plain.poses, more.poses);
}

Arrivals during(const Arrivals& all, std::int64_t first, std::int64_t last) {
  Arrivals part;
  for (const auto& arrival : all) {
    if (arrival.first >= first && arrival.first < last) part.push_back(arrival);
  }
  return part;
}

TEST(ChannelChange, MeetsBeforeAndAfterWhatRunsWithTheseSettingsMeet) {
  const std::vector<std::string> worse{"channel.uplink.markov.bad.prr=0.1",
                                       "channel.uplink.loss=0.3"};
  const LoopRun plain(through_netem(kBadNetwork)), bad(through_netem(kBadNetwork, worse));
  const LoopRun changed(through_netem(
      kBadNetwork,
      {"channel.change=[{at_s=20, set=['uplink.markov.bad.prr=0.1', 'uplink.loss=0.3']}]"}));
  constexpr std::int64_t kChange = 400;  // poses at 20 Hz
  EXPECT_EQ(during(changed.poses, 0, kChange), during(plain.poses, 0, kChange));
  EXPECT_EQ(during(changed.poses, kChange, 9999), during(bad.poses, kChange, 9999));
  EXPECT_NE(during(changed.poses, kChange, 9999), during(plain.poses, kChange, 9999));
}

TEST(ChannelChange, ThatIsRefusedInTheMiddleOfARunLeavesItAsItWas) {
  const LoopRun plain(through_netem(kBadNetwork));
  LoopRun asked(through_netem(kBadNetwork), {"uplink.loss=0.9", "downlink.prr=0.5"});
  EXPECT_EQ(asked.poses, plain.poses);
  EXPECT_EQ(asked.commands, plain.commands);
}

const std::vector<std::string> kDamage{
    "run.duration_s=60",         "sensor.rate_hz=50",
    "channel.delay_ms=20",       "channel.corrupt.probability=0.5",
    "channel.corrupt.bits=4",    "channel.duplicate.probability=0.2",
    "channel.jitter.law=normal", "channel.jitter.sd_ms=15"};

TEST(Corruption, IsSurvivedByControllerAndVehicleAndCounted) {
  for (const char* seed : {"run.seed=1", "run.seed=2", "run.seed=3"}) {
    LoopRun run(through_netem(kDamage, {seed}));
    EXPECT_GT(run.loop.netem().uplink().counters().corrupted, 1000);
    EXPECT_GT(counter(run.counters["CTRL/COUNTERS"], "pose.undecodable"), 50);
    EXPECT_GT(counter(run.counters["SIM/COUNTERS"], "command.undecodable"), 50);
    EXPECT_TRUE(std::isfinite(run.loop.sim().metrics().epsilon_m()));
  }
}

TEST(Corruption, IsSurvivedByTheCanBridge) {
  LoopRun run(load_scenario(in_source("/scenarios/hil_vcan.toml"), kDamage));
  EXPECT_GT(run.loop.netem().downlink().counters().corrupted, 500);
  EXPECT_GT(counter(run.counters["CAN/COUNTERS"], "command.undecodable"), 50);
  EXPECT_TRUE(std::isfinite(run.loop.sim().metrics().epsilon_m()));
}

TEST(EveryModel, RunsTheLoopAndAccountsForEveryPacket) {
  const std::vector<std::string> models[] = {
      {"channel.model=four_state", "channel.four_state.p13=0.05", "channel.four_state.p31=0.3"},
      {"channel.model=chain", "channel.chain.prr=[1.0, 0.6, 0.0]",
       "channel.chain.delay_ms=[0.0, 50.0, 0.0]",
       "channel.chain.rates_per_s=[[0, 1, 0.1], [2, 0, 1], [0, 5, 0]]"},
      {"channel.model=chain", "channel.chain.prr=[1.0, 0.2]",
       "channel.chain.probabilities=[[0.9, 0.1], [0.3, 0.7]]"}};
  for (const auto& model : models) {
    auto keys = kDamage;
    keys[2] = "channel.slot.period_ms=10";
    keys.insert(keys.end(), {"channel.rate.bits_per_s=1e5", "channel.outages=[[10, 12]]"});
    const LoopRun run(through_netem(keys, model));
    for (const Link* link : {&run.loop.netem().uplink(), &run.loop.netem().downlink()}) {
      const Link::Counters& c = link->counters();
      EXPECT_GT(c.delivered, 100);
      EXPECT_GT(c.outage_dropped, 0);
      EXPECT_EQ(c.offered + c.duplicated,
                c.outage_dropped + c.lost + c.overflowed + c.delivered + link->in_flight());
    }
  }
}

}  // namespace
}  // namespace tether
