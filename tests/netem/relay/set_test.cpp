#include <gmock/gmock.h>

#include <string>
#include <tether/channel_setting_result_t.hpp>
#include <tether/channel_setting_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/link_report_t.hpp>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/models/state_process.hpp"
#include "netem/relay/netem_node.hpp"
#include "tests/support/virtual_world.hpp"

// The relay's answers to NET/SET, and what it does with its links then.

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::counter;
using test::pose;
using test::Seen;
using test::VirtualWorld;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Settings = std::vector<std::string>;

/// A relay that has made its first reports; the next periodic ones come at 1000 s.
struct Relay {
  explicit Relay(const Settings& keys = {}, const std::string& toml = "")
      : scenario(parse_scenario(toml, "test.toml", with_period(keys))),
        node(scenario, world.loop, world.bus, world.bus) {
    world.collect("NET/SETTINGS", answers);
    world.collect("NET/SET", requests);
    world.collect("NET/UPLINK", uplink);
    world.collect("NET/DOWNLINK", downlink);
    world.collect("NET/COUNTERS", counters);
    world.collect("CTRL/POSE", poses);
    world.loop.run_until(kStart);
    uplink.clear(), downlink.clear();
  }

  static Settings with_period(Settings keys) {
    keys.emplace_back("run.report_period_s=1000");
    return keys;
  }

  void ask_at(Instant when, const Settings& settings, std::int64_t seq = 0) {
    world.publish_at(when, "NET/SET", setting_request(to_utime(when), seq, settings));
  }

  VirtualWorld world;
  Scenario scenario;
  NetemNode node;
  std::vector<Seen<channel_setting_result_t>> answers;
  std::vector<Seen<channel_setting_t>> requests;
  std::vector<Seen<link_report_t>> uplink, downlink;
  std::vector<Seen<counters_t>> counters;
  std::vector<Seen<pose_t>> poses;
};

TEST(NetemNodeSettings, AreInForceFromTheInstantOfTheRequestOn) {
  Relay relay;
  const Duration tick{1};
  relay.world.publish_at(at_s(1) - tick, "AGV/POSE", pose(at_s(1), 1));
  relay.ask_at(at_s(1), {"uplink.prr=0"});
  relay.world.publish_at(at_s(1), "AGV/POSE", pose(at_s(1), 2));
  relay.world.publish_at(at_s(1) + tick, "AGV/POSE", pose(at_s(1), 3));
  relay.ask_at(at_s(2), {"uplink.prr=1"});
  relay.world.publish_at(at_s(2), "AGV/POSE", pose(at_s(2), 4));
  relay.world.loop.run_until(at_s(3));
  ASSERT_EQ(relay.poses.size(), 2U);
  EXPECT_EQ(relay.poses[0].message.seq, 1);
  EXPECT_EQ(relay.poses[1].message.seq, 4);
}

TEST(NetemNodeSettings, AreAnsweredAndReportedAtOnce) {
  Relay relay;
  relay.ask_at(at_s(1), {"downlink.prr=0.25", "downlink.delay_ms=40"}, 7);
  relay.world.loop.run_until(at_s(2));
  ASSERT_EQ(relay.answers.size(), 1U);
  const channel_setting_result_t& answer = relay.answers[0].message;
  EXPECT_EQ(answer.utime, 1'000'000);
  EXPECT_EQ(answer.seq, 0);
  EXPECT_EQ(answer.request_utime, 1'000'000);
  EXPECT_EQ(answer.request_seq, 7);
  EXPECT_TRUE(answer.applied);
  EXPECT_EQ(answer.reason, "");
  EXPECT_THAT(answer.key, ElementsAre("downlink.prr", "downlink.delay_ms"));
  EXPECT_THAT(answer.value, ElementsAre("0.25", "40.0"));
  for (const auto* reports : {&relay.uplink, &relay.downlink}) {
    ASSERT_EQ(reports->size(), 1U);
    EXPECT_EQ((*reports)[0].when, at_s(1));
  }
  EXPECT_EQ(relay.downlink[0].message.state_prr, 0.25);
  EXPECT_EQ(relay.downlink[0].message.state_delay_ms, 40.0);
  EXPECT_EQ(relay.uplink[0].message.state_prr, 1.0);
}

TEST(NetemNodeSettings, ThatAreRefusedAreAnsweredWithTheReasonAndReportNothing) {
  Relay relay;
  relay.ask_at(at_s(1), {"uplink.prr=0", "downlink.prr=7"});
  relay.world.loop.run_until(at_s(2));
  ASSERT_EQ(relay.answers.size(), 1U);
  EXPECT_FALSE(relay.answers[0].message.applied);
  EXPECT_EQ(relay.answers[0].message.reason.find(
                "downlink.prr=7: channel.downlink.prr = 7 is not allowed: must be a number in"),
            0U);
  EXPECT_EQ(relay.answers[0].message.count, 0);
  EXPECT_TRUE(relay.uplink.empty());
  EXPECT_EQ(relay.node.uplink().process().condition().prr, 1.0);
  relay.node.finish();
  relay.world.loop.run_until(at_s(2));
  EXPECT_EQ(counter(relay.counters.back().message, "settings.refused"), 1);
  EXPECT_EQ(counter(relay.counters.back().message, "settings.applied"), -1);
}

TEST(NetemNodeSettings, OfLinksThatItDoesNotHaveAreRefused) {
  Relay relay({"channel.links.foo.prr=0.5"});
  relay.ask_at(at_s(1), {"links.foo.prr=0.2"});
  relay.world.loop.run_until(at_s(2));
  ASSERT_EQ(relay.answers.size(), 1U);
  EXPECT_FALSE(relay.answers[0].message.applied);
  EXPECT_EQ(relay.answers[0].message.reason,
            "links.foo.prr=0.2 has no effect: the relay has no link but uplink, downlink");
}

TEST(NetemNodeSettings, OfARequestThatComesAgainAreAnsweredAgainAndAppliedOnce) {
  Relay relay;
  const auto first = setting_request(5, 1, {"uplink.prr=0.3"});
  const auto second = setting_request(6, 1, {"uplink.prr=0.6"});
  relay.world.publish_at(at_s(1), "NET/SET", first);
  relay.world.publish_at(at_s(2), "NET/SET", second);
  relay.world.publish_at(at_s(3), "NET/SET", first);
  relay.world.loop.run_until(at_s(4));
  ASSERT_EQ(relay.answers.size(), 3U);
  const auto& again = relay.answers[2].message;
  EXPECT_EQ(again.request_utime, 5);
  EXPECT_TRUE(again.applied);
  EXPECT_THAT(again.value, ElementsAre("0.3"));
  EXPECT_EQ(again.utime, 3'000'000);
  EXPECT_EQ(relay.node.uplink().process().condition().prr, 0.6);
  EXPECT_EQ(relay.uplink.size(), 2U);
  relay.node.finish();
  relay.world.loop.run_until(at_s(4));
  EXPECT_EQ(counter(relay.counters.back().message, "settings.applied"), 2);
  EXPECT_EQ(counter(relay.counters.back().message, "settings.repeated"), 1);
}

TEST(NetemNodeSettings, OfARequestWithoutAnyAreThoseInForce) {
  Relay relay({"channel.uplink.delay_ms=5"});
  relay.ask_at(at_s(1), {"downlink.loss=0.5"});
  relay.ask_at(at_s(2), {});
  relay.ask_at(at_s(3), {}, 0);
  relay.world.loop.run_until(at_s(4));
  ASSERT_EQ(relay.answers.size(), 3U);
  EXPECT_TRUE(relay.answers[1].message.applied);
  EXPECT_THAT(relay.answers[1].message.key, ElementsAre("uplink.delay_ms", "downlink.loss"));
  EXPECT_THAT(relay.answers[1].message.value, ElementsAre("5.0", "0.5"));
  EXPECT_EQ(relay.uplink.size(), 1U);  // only the change is reported
}

TEST(NetemNodeSettings, ThatAreVeryLongAreCutOffInTheAnswer) {
  std::string table = "[0.0";
  for (int i = 1; i < 5000; ++i) table += ", " + std::to_string(i) + ".0";
  Relay relay;
  relay.ask_at(at_s(1), {"uplink.jitter.law=table", "uplink.jitter.table_ms=" + table + "]"});
  relay.world.loop.run_until(at_s(2));
  ASSERT_EQ(relay.answers.size(), 1U);
  EXPECT_TRUE(relay.answers[0].message.applied);
  const std::string& value = relay.answers[0].message.value.at(1);
  EXPECT_EQ(value.size(), 1003U);
  EXPECT_THAT(value, ::testing::EndsWith("..."));
}

TEST(NetemNodeSettings, AfterAChangeOnlyTheNewStatesTransitionsAreReported) {
  Relay relay({"channel.uplink.model=markov", "channel.uplink.markov.mean_good_s=0.5",
               "channel.uplink.markov.mean_bad_s=0.5"});
  relay.ask_at(at_s(10), {"uplink.markov.mean_good_s=2", "uplink.markov.mean_bad_s=1"});
  relay.ask_at(at_s(50), {"uplink.markov.bad.prr=0.1"});
  relay.world.loop.run_until(at_s(99));

  std::vector<Instant> expected;
  const auto add = [&](double good_s, double bad_s, Instant from, Instant until) {
    StateProcess state =
        StateProcess::markov(good_s, bad_s, link_streams(relay.scenario, "uplink")("state"));
    for (Instant t = state.next_transition(); t <= until; t = state.next_transition()) {
      if (t > from) expected.push_back(t);
      state.advance(t);
    }
  };
  add(0.5, 0.5, kStart, at_s(10));
  expected.push_back(at_s(10));
  add(2, 1, at_s(10), at_s(50));
  expected.push_back(at_s(50));
  add(2, 1, at_s(50), at_s(99));
  std::vector<Instant> reported;
  for (const auto& report : relay.uplink) reported.push_back(report.when);
  EXPECT_GT(expected.size(), 50U);
  EXPECT_EQ(reported, expected);
}

TEST(NetemNodeSettings, CanTurnToAMapThatFollowsTheVehicle) {
  Relay relay;
  relay.ask_at(at_s(1), {"uplink.model=map", "uplink.map.access_points=[[0, 0]]",
                         "uplink.map.prr_curve=[[14, 0], [15, 1]]"});
  relay.world.publish_at(at_s(2), "AGV/POSE", pose(at_s(2), 1, 1.0));
  relay.world.publish_at(at_s(3), "AGV/POSE", pose(at_s(3), 2, 500.0));
  relay.ask_at(at_s(4), {"uplink.model=fixed"});
  relay.world.publish_at(at_s(5), "AGV/POSE", pose(at_s(5), 3, 500.0));
  relay.world.loop.run_until(at_s(6));
  ASSERT_EQ(relay.poses.size(), 2U);
  EXPECT_EQ(relay.poses[0].message.seq, 1);
  EXPECT_EQ(relay.poses[1].message.seq, 3);
}

TEST(NetemNodeSettings, OfTheScenariosChangesAreAskedForOnTheBus) {
  Relay relay({},
              "[[channel.change]]\nat_s = 1.0\nset = [\"uplink.prr=0\"]\n"
              "[[channel.change]]\nat_s = 2.0\nset = [\"uplink.prr=1\"]\n");
  relay.world.publish_at(at_s(1) - Duration{1}, "AGV/POSE", pose(at_s(1), 1));
  relay.world.publish_at(at_s(1), "AGV/POSE", pose(at_s(1), 2));
  relay.world.publish_at(at_s(2), "AGV/POSE", pose(at_s(2), 3));
  relay.world.loop.run_until(at_s(3));
  ASSERT_EQ(relay.requests.size(), 2U);
  EXPECT_EQ(relay.requests[0].when, at_s(1));
  EXPECT_EQ(relay.requests[0].message.utime, 1'000'000);
  EXPECT_EQ(relay.requests[1].message.seq, 1);
  EXPECT_EQ(relay.answers.size(), 2U);
  ASSERT_EQ(relay.poses.size(), 2U);
  EXPECT_EQ(relay.poses[0].message.seq, 1);
  EXPECT_EQ(relay.poses[1].message.seq, 3);
}

TEST(NetemNodeSettings, FromTheOtherSideAreTakenAndAnsweredOnBothSides) {
  VirtualWorld world;
  InProcessBus control(world.loop);
  NetemNode node(parse_scenario("", "x", {}), world.loop, world.bus, control);
  std::vector<Seen<channel_setting_result_t>> answers;
  world.collect("NET/SETTINGS", answers);
  std::int64_t there = 0, undecodable = 0;
  subscribe<channel_setting_result_t>(control, "NET/SETTINGS", kDeepQueue, undecodable,
                                      [&](const auto&) { ++there; });
  publish(control, "NET/SET", setting_request(1, 1, {"prr=0.5"}));
  world.loop.run_until(at_s(1));
  EXPECT_EQ(answers.size(), 1U);
  EXPECT_EQ(there, 1);
  EXPECT_EQ(node.downlink().process().condition().prr, 0.5);
}

TEST(NetemNodeSettings, ThatCannotBeDecodedAreCounted) {
  Relay relay;
  relay.world.publish_bytes_at(at_s(1), "NET/SET", {1, 2, 3});
  relay.world.loop.run_until(at_s(2));
  relay.node.finish();
  relay.world.loop.run_until(at_s(2));
  EXPECT_TRUE(relay.answers.empty());
  EXPECT_EQ(counter(relay.counters.back().message, "settings.undecodable"), 1);
}

TEST(NetemNodeSettings, OfAChangeThatCannotBeDoneAreRefusedBeforeTheRun) {
  const std::string toml =
      "[[channel.change]]\nat_s = 1.0\nset = [\"model=trace\", \"trace.file=nowhere.csv\"]\n";
  EXPECT_THROW(Relay({}, toml), UsageError);
}

}  // namespace
}  // namespace tether
