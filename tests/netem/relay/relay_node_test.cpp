#include <gmock/gmock.h>

#include <map>
#include <memory>
#include <string>
#include <tether/channel_setting_result_t.hpp>
#include <tether/channel_setting_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/link_report_t.hpp>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "common/node/virtual_loop.hpp"
#include "netem/relay/relay_rule.hpp"
#include "tests/support/peer_bus.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::counter;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::string kOwn = "udpm://239.255.76.67:7667?ttl=0";
const std::string kOther = "udpm://239.255.76.67:7668?ttl=0";

/// A relay between networks in virtual time. A network's traffic is written as "CHANNEL=bytes".
class Relay {
 public:
  using Bytes = std::vector<std::uint8_t>;

  explicit Relay(const std::vector<std::string>& rules, std::vector<std::string> overrides = {},
                 const std::string& toml = "") {
    const Scenario scenario = parse_scenario(toml, "test.toml", overrides);
    const auto parsed = parse_relay_rules(rules, kOwn, scenario);
    const auto network_at = [this](const std::string& url) {
      return std::make_unique<test::PeerBus>(at(url), loop);
    };
    at(kOwn + "&recv_buf_size=2097152").subscribe("NET/COUNTERS", 1, [this](const Message& m) {
      decode(m.bytes, counters);
    });
    node = std::make_unique<RelayNode>(scenario, parsed, loop, kOwn + "&recv_buf_size=2097152",
                                       network_at);
    for (const auto& [url, bus] : buses_) {
      bus->subscribe(".*", kDeepQueue, [this, to = &seen[url]](const Message& m) {
        if (m.channel.starts_with("NET/")) return;
        std::string text(m.channel);
        text += "=" + std::string(m.bytes.begin(), m.bytes.end());
        to->push_back(text);
        when.push_back(loop.now());
      });
    }
  }

  void send(Instant when, const std::string& url, const std::string& channel, Bytes bytes) {
    loop.at(when, Priority::node, [this, url, channel, bytes = std::move(bytes)](Instant) {
      at(url).publish(channel, bytes);
    });
  }
  void send(Instant when, const std::string& url, const std::string& channel,
            const std::string& text) {
    send(when, url, channel, Bytes(text.begin(), text.end()));
  }
  void run(Instant end = at_s(10)) { loop.run_until(end); }

  InProcessBus& at(const std::string& url) {
    auto& bus = buses_[network_address(url)];
    if (!bus) bus = std::make_unique<InProcessBus>(loop);
    return *bus;
  }
  const std::vector<std::string>& on(const std::string& url) { return seen[network_address(url)]; }

  VirtualLoop loop;
  std::map<std::string, std::vector<std::string>> seen;
  std::vector<Instant> when;
  counters_t counters{};
  std::unique_ptr<RelayNode> node;

 private:
  std::map<std::string, std::unique_ptr<InProcessBus>> buses_;
};

TEST(RelayNode, CarriesWhatTheRuleIsAboutUnderItsNewName) {
  Relay relay({"CAM_(.*) -> " + kOther + ":FAR/$1 via sat"}, {"channel.links.sat.delay_ms=300"});
  relay.send(at_s(1), kOwn, "CAM_LEFT", "a");
  relay.send(at_s(1), kOwn, "XCAM_LEFT", "b");
  relay.send(at_s(1), kOther, "CAM_LEFT", "c");
  relay.run();
  EXPECT_THAT(relay.on(kOwn), ElementsAre("CAM_LEFT=a", "XCAM_LEFT=b"));
  EXPECT_THAT(relay.on(kOther), ElementsAre("CAM_LEFT=c", "FAR/LEFT=a"));
  EXPECT_EQ(relay.when.back(), at_ms(1300));
}

TEST(RelayNode, BytesArePassedOnWhateverTheyAre) {
  Relay relay({"X(.*) -> " + kOther + ":Y$1 via uplink"});
  const std::string strange = "X \xc3\xa4/\t{}%" + std::string(50, 'n');
  relay.send(at_s(1), kOwn, strange, std::string());
  relay.send(at_s(2), kOwn, "X", std::string(300'000, '\xff'));
  relay.run();
  EXPECT_THAT(relay.on(kOther),
              ElementsAre("Y" + strange.substr(1) + "=", "Y=" + std::string(300'000, '\xff')));
}

TEST(RelayNode, ChannelsOfEqualNameCanBeBridgedBothWays) {
  Relay relay({"FOO -> " + kOther + " via uplink", kOther + ":FOO -> FOO via downlink"},
              {"channel.delay_ms=20"});
  relay.send(at_s(1), kOwn, "FOO", "a");
  relay.send(at_s(2), kOther, "FOO", "b");
  relay.run();
  EXPECT_THAT(relay.on(kOwn), ElementsAre("FOO=a", "FOO=b"));
  EXPECT_THAT(relay.on(kOther), ElementsAre("FOO=a", "FOO=b"));
}

TEST(RelayNode, AConstantHeartbeatFromBothSidesIsNotEaten) {
  Relay relay({"BEAT -> " + kOther + " via uplink", kOther + ":BEAT -> BEAT via downlink"},
              {"channel.delay_ms=20"});
  for (int i = 0; i < 500; ++i) {
    relay.send(at_ms(10 * i), kOwn, "BEAT", "same");
    relay.send(at_ms(10 * i), kOther, "BEAT", "same");
  }
  relay.run();
  EXPECT_EQ(relay.on(kOwn).size(), 1000U);
  EXPECT_EQ(relay.on(kOther).size(), 1000U);
  EXPECT_EQ(relay.node->link("uplink").counters().offered, 500);
  EXPECT_EQ(relay.node->link("downlink").counters().offered, 500);
}

TEST(RelayNode, CopiesAndLatePacketsDoNotComeBack) {
  Relay relay({"FOO -> " + kOther + " via uplink", kOther + ":FOO -> FOO via downlink"},
              {"channel.delay_ms=700", "channel.duplicate.probability=1",
               "channel.jitter.law=uniform", "channel.jitter.sd_ms=300"});
  for (int i = 0; i < 100; ++i) relay.send(at_ms(10 * i), kOwn, "FOO", "same");
  relay.run();
  EXPECT_EQ(relay.on(kOther).size(), 200U);
  EXPECT_EQ(relay.on(kOwn).size(), 100U);
  EXPECT_EQ(relay.node->link("downlink").counters().offered, 0);
}

TEST(RelayNode, RulesThatFeedEachOtherInOneNetworkDoNot) {
  Relay relay({"A -> B via uplink", "B -> A via downlink"});
  relay.send(at_s(1), kOwn, "A", "1");
  relay.send(at_s(2), kOwn, "B", "2");
  relay.run();
  EXPECT_THAT(relay.on(kOwn), ElementsAre("A=1", "B=1", "B=2", "A=2"));
}

TEST(RelayNode, ANameThatStaysOrThatNoChannelCanHaveIsRefusedAndCounted) {
  Relay relay({"(A*)(B?) -> $1 via uplink", "(L) -> $1" + std::string(63, 'x') + " via uplink"});
  relay.send(at_s(1), kOwn, "AA", "stays");
  relay.send(at_s(2), kOwn, "B", "has no name");
  relay.send(at_s(3), kOwn, "AB", "passes");
  relay.send(at_s(4), kOwn, "L", "too long");
  relay.run();
  EXPECT_EQ(relay.on(kOwn).size(), 5U);
  EXPECT_EQ(relay.on(kOwn)[3], "A=passes");
  EXPECT_EQ(counter(relay.counters, "names.refused"), 3);
  EXPECT_EQ(counter(relay.counters, "heard"), 4);
}

TEST(RelayNode, EveryRuleThatIsAboutAMessageTakesItOnce) {
  Relay relay({"FO(.*) -> " + kOther + ":X$1 via uplink", "F(O+) -> " + kOther + ":Y$1 via sat",
               "FOO -> Z via downlink"},
              {"channel.links.sat.delay_ms=1"});
  relay.send(at_s(1), kOwn, "FOO", "1");
  relay.send(at_s(2), kOwn, "FOX", "2");
  relay.run();
  EXPECT_THAT(relay.on(kOther), ElementsAre("XO=1", "YOO=1", "XX=2"));
  EXPECT_THAT(relay.on(kOwn), ElementsAre("FOO=1", "Z=1", "FOX=2"));
}

TEST(RelayNode, RulesMayShareALinkToSeveralNetworks) {
  Relay relay(
      {"A -> " + kOther + " via uplink", "A -> udpm://239.255.76.67:7669?ttl=0:B via uplink"},
      {"channel.uplink.queue_limit=1", "channel.uplink.delay_ms=10"});
  relay.send(at_s(1), kOwn, "A", "1");
  relay.run();
  EXPECT_THAT(relay.on(kOther), ElementsAre("A=1"));
  EXPECT_THAT(relay.on("udpm://239.255.76.67:7669?ttl=0"), IsEmpty());
  EXPECT_EQ(relay.node->link("uplink").counters().overflowed, 1);
}

TEST(RelayNode, ReportsEveryLinkAndDoesNotRelayItsReports) {
  Relay relay({".* -> " + kOther + ":FROM/$& via sat", "X -> Y via uplink"},
              {"channel.links.sat.prr=0.5", "channel.links.sat.delay_ms=7"});
  std::vector<link_report_t> reports;
  std::int64_t undecodable = 0;
  subscribe<link_report_t>(relay.at(kOwn), "NET/(SAT|UPLINK)", 1, undecodable,
                           [&reports](const link_report_t& m) { reports.push_back(m); });
  relay.send(at_s(1), kOwn, "FOO", "1");
  relay.run();
  ASSERT_GE(reports.size(), 20U);
  EXPECT_EQ(reports[0].link, "sat");
  EXPECT_EQ(reports[0].state_prr, 0.5);
  EXPECT_EQ(reports[1].link, "uplink");
  EXPECT_EQ(relay.node->link("sat").counters().offered, 1);
  EXPECT_EQ(counter(relay.counters, "sat.offered"), 1);
  EXPECT_EQ(undecodable, 0);
}

/// Answers of a relay to settings, requested one second after the other from 1 s on.
std::vector<channel_setting_result_t> answers(Relay& relay,
                                              const std::vector<std::vector<std::string>>& asked) {
  std::vector<channel_setting_result_t> heard;
  std::int64_t undecodable = 0;
  subscribe<channel_setting_result_t>(
      relay.at(kOwn), "NET/SETTINGS", kDeepQueue, undecodable,
      [&heard](const channel_setting_result_t& m) { heard.push_back(m); });
  for (std::size_t i = 0; i < asked.size(); ++i) {
    const Instant when = at_s(1.0 + static_cast<double>(i));
    relay.loop.at(when, Priority::node, [&relay, when, settings = asked[i]](Instant) {
      publish(relay.at(kOwn), "NET/SET", setting_request(to_utime(when), 0, settings));
    });
  }
  relay.run(at_s(1.5 + static_cast<double>(asked.size())));
  return heard;
}

TEST(RelayNodeSettings, OfLinksThatItsRulesUseAreInForceAtOnce) {
  Relay relay({"F -> G via sat", "F -> H via uplink"}, {"channel.links.sat.delay_ms=1"});
  for (int i = 1; i <= 4; ++i) relay.send(at_ms(1000 * i - 100), kOwn, "F", std::to_string(i));
  const auto heard = answers(relay, {{"links.sat.prr=0", "links.sat.delay_ms=2"}, {"prr=0"}, {}});
  ASSERT_EQ(heard.size(), 3U);
  EXPECT_TRUE(heard[0].applied);
  EXPECT_EQ(heard[0].utime, 1'000'000);
  EXPECT_THAT(heard[0].key, ElementsAre("links.sat.prr", "links.sat.delay_ms"));
  EXPECT_THAT(heard[0].value, ElementsAre("0.0", "2.0"));
  EXPECT_THAT(heard[1].key, ElementsAre("uplink.prr"));  // there is no downlink
  EXPECT_THAT(heard[2].key, ElementsAre("uplink.prr", "links.sat.prr", "links.sat.delay_ms"));
  EXPECT_THAT(relay.on(kOwn), ElementsAre("F=1", "H=1", "G=1", "F=2", "H=2", "F=3", "F=4"));
  EXPECT_EQ(counter(relay.counters, "settings.applied"), 2);
}

TEST(RelayNodeSettings, OfOtherLinksAreRefusedWithThoseInUse) {
  Relay relay({"F -> G via sat", "F -> H via uplink"}, {"channel.links.sat.delay_ms=1"});
  const auto heard =
      answers(relay, {{"uplink.prr=0", "downlink.prr=0"},
                      {"links.foo.prr=0.2"},
                      {"links.sat.prrr=0"},
                      {"links.sat.model=map", "links.sat.map.access_points=[[0, 0]]"},
                      {}});
  ASSERT_EQ(heard.size(), 5U);
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(heard[static_cast<std::size_t>(i)].applied) << i;
  EXPECT_EQ(heard[0].reason, "downlink.prr=0 has no effect: the rules use no link but sat, uplink");
  EXPECT_EQ(heard[1].reason,
            "links.foo.prr=0.2 has no effect: the rules use no link but sat, uplink");
  EXPECT_THAT(
      heard[2].reason,
      HasSubstr("unknown key \"links.sat.prrr\" in [channel] (did you mean \"links.sat.prr\"?"));
  EXPECT_THAT(heard[3].reason, HasSubstr("rules decode nothing"));
  EXPECT_THAT(heard[4].key, ElementsAre("links.sat.delay_ms"));
}

TEST(RelayNodeSettings, OfTheScenariosChangesAreAskedForAndInForceOnce) {
  Relay relay({"F -> G via uplink"}, {},
              "[[channel.change]]\nat_s = 1.0\nset = [\"uplink.prr=0\"]\n"
              "[[channel.change]]\nat_s = 3.0\nset = [\"uplink.prr=1\"]\n");
  std::vector<channel_setting_t> requests;
  std::int64_t undecodable = 0;
  subscribe<channel_setting_t>(relay.at(kOwn), "NET/SET", kDeepQueue, undecodable,
                               [&](const channel_setting_t& m) { requests.push_back(m); });
  for (int i = 0; i < 40; ++i) relay.send(at_ms(100 * i), kOwn, "F", std::to_string(i));
  const auto heard = answers(relay, {});
  relay.run();
  ASSERT_EQ(requests.size(), 2U);
  EXPECT_EQ(requests[1].utime, 3'000'000);
  EXPECT_EQ(counter(relay.counters, "settings.applied"), 2);
  EXPECT_EQ(counter(relay.counters, "settings.repeated"), -1);
  EXPECT_EQ(relay.node->link("uplink").counters().lost, 20);
  EXPECT_EQ(relay.on(kOwn).size(), 60U);
}

TEST(RelayNodeSettings, OfAChangeThatNoRuleMeetsAreRefusedBeforeTheStart) {
  try {
    Relay({"F -> G via uplink"}, {},
          "[[channel.change]]\nat_s = 1.0\nset = [\"downlink.prr=0\"]\n");
    ADD_FAILURE() << "accepted";
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(),
                 "channel.change at 1 s: downlink.prr=0 has no effect: the rules use "
                 "no link but uplink");
  }
}

TEST(RelayNode, CountsBalanceOnALossyLink) {
  Relay relay({"F.* -> " + kOther + ":G via sat"},
              {"channel.links.sat.prr=0.7", "channel.links.sat.queue_limit=40",
               "channel.links.sat.delay_ms=100"});
  for (int i = 0; i < 2000; ++i) relay.send(at_ms(2 * i), kOwn, "F" + std::to_string(i), "x");
  relay.run(at_s(20));
  const Link::Counters& c = relay.node->link("sat").counters();
  EXPECT_EQ(c.offered, 2000);
  EXPECT_EQ(c.offered, c.lost + c.overflowed + c.delivered);
  EXPECT_GT(c.overflowed, 0);
  EXPECT_NEAR(static_cast<double>(c.lost), 600, 4 * 20.5);  // binomial, 4 standard deviations
  EXPECT_EQ(relay.on(kOther).size(), static_cast<std::size_t>(c.delivered));
}

TEST(RelayNode, AnotherLinkChangesNothingOfTheFirst) {
  const std::vector<std::string> base{"channel.links.sat.prr=0.5"};
  std::vector<std::string> more = base;
  more.insert(more.end(), {"channel.links.lan.prr=0.5", "channel.uplink.prr=0.5"});
  Relay alone({"F -> G via sat"}, base);
  Relay beside({"F -> H via lan", "F -> I via uplink", "F -> G via sat"}, more);
  for (Relay* relay : {&alone, &beside}) {
    for (int i = 0; i < 200; ++i) relay->send(at_ms(10 * i), kOwn, "F", std::to_string(i));
    relay->run();
  }
  const auto passed = [](Relay& relay) {
    std::vector<std::string> some;
    for (const std::string& text : relay.on(kOwn)) {
      if (text[0] == 'G') some.push_back(text);
    }
    return some;
  };
  EXPECT_GT(passed(alone).size(), 50U);
  EXPECT_EQ(passed(alone), passed(beside));
}

}  // namespace
}  // namespace tether
