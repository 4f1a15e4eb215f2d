#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/chain.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/markov.hpp"
#include "netem/stages/jitter_laws.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

std::string uplink(const std::string& lines) { return "[channel.uplink]\n" + lines + "\n"; }

Scenario parse(const std::string& toml, const std::vector<std::string>& overrides = {}) {
  return parse_scenario(toml, "test.toml", overrides);
}

/// Error text when `toml` with `overrides` is refused.
std::string section_refusal(const std::string& toml,
                            const std::vector<std::string>& overrides = {}) {
  return refusal_of([&] { parse(toml, overrides); });
}

/// One of each model and all stages.
const std::string kScenarios[] = {
    uplink("model = \"gilbert_elliott\"\ngilbert_elliott = { p = 0.1, r = 0.3, one_minus_h = 0.9, "
           "one_minus_k = 0.01 }\ndelay_ms = 5.0"),
    uplink("model = \"gilbert_elliott\"\ngilbert_elliott = { prr = 0.3, mean_burst = 7.0 }"),
    uplink("model = \"four_state\"\nfour_state = { p13 = 0.1 }"),
    uplink("model = \"four_state\"\nfour_state = { p13 = 0.1, p31 = 0.2, p32 = 0.3, p23 = 0.4, "
           "p14 = 0.5 }"),
    uplink("model = \"chain\"\nchain = { prr = [1, 0.5], rates_per_s = [[0, 1], [2, 0]] }"),
    uplink("model = \"chain\"\nchain = { prr = [1.0, 0.5], delay_ms = [0.0, 7.5], probabilities = "
           "[[0.9, 0.1], [0.5, 0.5]], step_s = 0.25 }"),
    uplink("outages = [[1, 2.5], [3, 4]]\nloss = 0.25\nin_order = true\ncorrupt = { probability = "
           "0.1, bits = 3 }\nduplicate.probability = 0.2\nrate = { bits_per_s = 1e6, queue_packets "
           "= 5, queue_bytes = 999, overhead_bytes = 28 }\njitter = { law = \"gamma\", mean_ms = "
           "3.0, sd_ms = 2.0, correlation = 0.5 }\nslot = { period_ms = 10.0, jitter_ms = 2.0, "
           "packets = 3 }"),
    uplink("reorder = { probability = 0.1, gap = 4 }\njitter = { law = \"pareto\", mean_ms = 3.0, "
           "sd_ms = 2.0, shape = 2.5 }"),
    uplink("jitter = { law = \"table\", table_ms = [0.0, 1.0, 5.0] }"),
    uplink("jitter = { law = \"constant\", mean_ms = -3.0 }")};

TEST(ScenarioChannel, TheResolvedTextGivesTheSameScenario) {
  for (const std::string& text : kScenarios) {
    const Scenario scenario = parse(text);
    const Scenario again = parse(to_toml(scenario));
    EXPECT_EQ(to_toml(again), to_toml(scenario)) << text;
    for (const ScenarioKey& key : ScenarioSchema::all()->keys()) {
      EXPECT_EQ(key.get(again), key.get(scenario)) << key.name;
    }
  }
}

TEST(ScenarioChannel, TheResolvedTextNamesOnlyStagesThatAreOn) {
  const std::string text = to_toml(Scenario{});
  for (const char* stage :
       {"loss", "jitter", "reorder", "slot", "rate.", "corrupt", "duplicate", "outages", "in_order",
        "gilbert", "four_state", "chain", "trace", "map"}) {
    EXPECT_THAT(text, Not(HasSubstr(stage)));
  }
}

TEST(ScenarioChannel, AnOverrideWithoutDirectionSetsBoth) {
  const Scenario s = parse("", {"channel.model=chain", "channel.chain.prr=[1, 0]",
                                "channel.chain.rates_per_s=[[0, 1], [1, 0]]",
                                "channel.jitter.law=normal", "channel.jitter.sd_ms=3"});
  for (const LinkConfig& link :
       {s.get<ChannelSettings>().uplink, s.get<ChannelSettings>().downlink}) {
    EXPECT_EQ(link.model, "chain");
    EXPECT_EQ(link.own.get<ChainConfig>().prr, (std::vector<double>{1.0, 0.0}));
    EXPECT_EQ(link.own.get<JitterSettings>().sd_ms, 3.0);
  }
}

TEST(ScenarioChannel, ReceptionRatioAndMeanBurstBecomeTheChainsParameters) {
  const auto ge =
      parse(kScenarios[1]).get<ChannelSettings>().uplink.own.get<GilbertElliottConfig>();
  EXPECT_DOUBLE_EQ(*ge.r, 1.0 / 7.0);
  EXPECT_DOUBLE_EQ(*ge.p, 0.7 / (0.3 * 7.0));
  EXPECT_THAT(to_toml(parse(kScenarios[1])), Not(HasSubstr("mean_burst")));
}

TEST(ScenarioChannel, OneOfReceptionRatioAndMeanBurstKeepsTheOther) {
  const auto by_prr = parse(kScenarios[1], {"channel.uplink.gilbert_elliott.prr=0.8"})
                          .get<ChannelSettings>()
                          .uplink.own.get<GilbertElliottConfig>();
  EXPECT_DOUBLE_EQ(*by_prr.r, 1.0 / 7.0);
  EXPECT_NEAR(*by_prr.r / (*by_prr.p + *by_prr.r), 0.8, 1e-12);
  const auto by_burst = parse(kScenarios[1], {"channel.uplink.gilbert_elliott.mean_burst=10"})
                            .get<ChannelSettings>()
                            .uplink.own.get<GilbertElliottConfig>();
  EXPECT_DOUBLE_EQ(*by_burst.r, 0.1);
  EXPECT_NEAR(*by_burst.r / (*by_burst.p + *by_burst.r), 0.3, 1e-12);
  EXPECT_THAT(section_refusal(uplink("model = \"gilbert_elliott\"\ngilbert_elliott.prr = 0.5")),
              HasSubstr("prr and channel.uplink.gilbert_elliott.mean_burst are needed together"));
}

TEST(ScenarioChannel, BurstsTooShortForTheReceptionRatioAreExplained) {
  const std::string text =
      "model = \"gilbert_elliott\"\ngilbert_elliott = { prr = 0.2, mean_burst = ";
  EXPECT_THAT(section_refusal(uplink(text + "3.9 }")),
              AllOf(HasSubstr("test.toml: channel.uplink.gilbert_elliott.mean_burst = 3.9"),
                    HasSubstr("prr = 0.2"), HasSubstr("at least max(1, (1-prr)/prr) = 4")));
  EXPECT_EQ(section_refusal(uplink(text + "4.0 }")), "accepted");
  EXPECT_THAT(section_refusal(uplink(text + "0.5 }")), HasSubstr("must be a number in [1, "));
}

struct Refused {
  std::string lines;
  std::string message;
};

TEST(ScenarioChannel, WhatDoesNotFitTogetherIsRefused) {
  const std::string four = "model = \"four_state\"\nfour_state = ";
  const std::string chain = "model = \"chain\"\nchain = ";
  const std::string law = "jitter.law = ";
  const Refused cases[] = {
      {"model = \"gilbert_elliott\"", "needs channel.uplink.gilbert_elliott.p and r, or prr and"},
      {"model = \"gilbert_elliott\"\ngilbert_elliott = { p = 0.1, prr = 0.5, mean_burst = 4 }",
       "give either"},
      {"model = \"four_state\"", "needs channel.uplink.four_state.p13"},
      {four + "{ p13 = 0.6, p14 = 0.5 }", "p13 + p14 = 1.1 must not be above 1"},
      {four + "{ p13 = 0.1, p32 = 0.2 }", "p31 + p32 = 1.1 must not be above 1"},
      {"model = \"chain\"", "needs channel.uplink.chain.prr"},
      {chain + "{ prr = [1, 0] }", "one of channel.uplink.chain.rates_per_s and"},
      {chain + "{ prr = [1, 0], rates_per_s = [[0, 1]] }", "needs 2 rows"},
      {chain + "{ prr = [1, 0], rates_per_s = [[0, 1], [1]] }", "row 2 needs 2 entries, not 1"},
      {chain + "{ prr = [1, 0], rates_per_s = [[0, -1], [1, 0]] }", "must not be negative"},
      {chain + "{ prr = [1, 0], rates_per_s = [[0, 1e6], [1, 0]] }", "[-1000, 1000]"},
      {chain + "{ prr = [1, 0, 0], rates_per_s = [[0, 1, 1], [600, 0, 600], [1, 1, 0]] }",
       "row 2: the rates sum to 1200 per s, but the mean stay in a state must be at least 0.001 s"},
      {chain + "{ prr = [1, 0], step_s = 1e-4, probabilities = [[0, 1], [1, 0]] }",
       "step_s = 0.0001 must be 0 (a step per packet) or at least 0.001"},
      {chain + "{ prr = [1, 0], rates_per_s = [[-2, 1], [1, 0]] }", "row 1: the diagonal, -2"},
      {chain + "{ prr = [1, 0], probabilities = [[0.5, 0.4], [1, 0]] }", "row 1 must sum to 1"},
      {chain + "{ prr = [1, 0], delay_ms = [1], rates_per_s = [[0, 1], [1, 0]] }",
       "delay_ms needs 2 entries"},
      {chain + "{ prr = [1, 0], step_s = 1, rates_per_s = [[0, 1], [1, 0]] }",
       "chain.step_s has no effect: channel.uplink.chain.probabilities is not given"},
      {chain + "{ prr = [1, 2], rates_per_s = [[0, 1], [1, 0]] }", "each a number in [0, 1]"},
      {chain + "{ prr = [1, \"a\"], rates_per_s = [[0, 1], [1, 0]] }", "each a number in [0, 1]"},
      {law + "\"normal\"", "jitter.law = \"normal\" needs channel.uplink.jitter.sd_ms > 0"},
      {law + "\"gamma\"\njitter.sd_ms = 1", "needs channel.uplink.jitter.mean_ms in"},
      {law + "\"pareto\"\njitter.sd_ms = 1\njitter.shape = 2", "a number in (2, 1000]"},
      {law + "\"table\"", "needs one of channel.uplink.jitter.table_ms and"},
      {law + "\"table\"\njitter.table_ms = [2, 1]", "none below the one before"},
      {law + "\"table\"\njitter.table_ms = [1, 2]\njitter.sd_ms = 1", "jitter.law is \"table\""},
      {law + "\"normal\"\njitter.sd_ms = 1\njitter.shape = 4", "jitter.law is \"normal\""},
      {"jitter.sd_ms = 1", "jitter.sd_ms has no effect: channel.uplink.jitter.law is \"none\""},
      {"in_order = true\nreorder.probability = 0.1", "contradict each other"},
      {"reorder.gap = 3", "no effect: channel.uplink.reorder.probability is 0"},
      {"corrupt.bits = 3", "no effect: channel.uplink.corrupt.probability is 0"},
      {"rate.queue_packets = 3", "no effect: channel.uplink.rate.bits_per_s is 0"},
      {"slot.packets = 3", "no effect: channel.uplink.slot.period_ms is 0"},
      {"slot = { period_ms = 1, jitter_ms = 2 }",
       "must not be above channel.uplink.slot.period_ms"},
      {"outages = [[2, 1]]", "outages must be [[t1, t2], ...] with t1 < t2 <= the next t1"},
      {"outages = [[1, 3], [2, 4]]", "outages must be"},
      {"outages = [1, 2]", "a list of lists"},
      {"markov.good.prr = 1.0", "markov.good.prr has no effect: channel.uplink.model is \"fixed\""},
      {"model = \"chain\"\nprr = 0.5", "prr has no effect: channel.uplink.model is \"chain\""},
      {"four_state.p13 = 0.5", "four_state.p13 has no effect"}};
  for (const Refused& c : cases) {
    EXPECT_THAT(section_refusal(uplink(c.lines)),
                AllOf(HasSubstr("test.toml:"), HasSubstr(c.message)))
        << c.lines;
  }
}

TEST(ScenarioChannel, ASharedStateNeedsAModelThatMovesInTime) {
  const std::vector<std::string> shared{"channel.shared_state=true"};
  const auto with = [&](std::vector<std::string> keys) {
    keys.insert(keys.end(), shared.begin(), shared.end());
    return section_refusal("", keys);
  };
  EXPECT_THAT(with({"channel.model=gilbert_elliott", "channel.gilbert_elliott.p=0.1",
                    "channel.gilbert_elliott.r=0.1"}),
              HasSubstr("needs a model that moves in time: \"gilbert_elliott\""));
  const std::vector<std::string> chain{"channel.model=chain", "channel.chain.prr=[1, 0]",
                                       "channel.chain.rates_per_s=[[0, 1], [1, 0]]"};
  EXPECT_EQ(with(chain), "accepted");
  auto unequal = chain;
  unequal.emplace_back("channel.uplink.chain.rates_per_s=[[0, 2], [1, 0]]");
  EXPECT_THAT(with(unequal), HasSubstr("needs the same matrix"));
  const std::vector<std::string> map{"channel.model=map", "channel.map.access_points=[[0, 0]]"};
  EXPECT_EQ(with(map), "accepted");
  auto elsewhere = map;
  elsewhere.emplace_back("channel.uplink.map.access_points=[[5, 0]]");
  EXPECT_THAT(with(elsewhere), HasSubstr("needs the same map for uplink and downlink"));
}

TEST(ScenarioChannel, LinksByNameHaveTheKeysOfTheUplink) {
  const Scenario s = parse(
      "[channel.links.sat]\nmodel = \"gilbert_elliott\"\n"
      "gilbert_elliott = { prr = 0.8, mean_burst = 4.0 }\n[channel.links.lan]\n",
      {"channel.links.sat.delay_ms=270", "channel.links.new.loss=0.25", "channel.prr=0.5"});
  ASSERT_EQ(s.get<ChannelSettings>().links.size(), 3U);
  const LinkConfig& sat = s.get<ChannelSettings>().links.at("sat");
  EXPECT_EQ(sat.model, "gilbert_elliott");
  EXPECT_DOUBLE_EQ(*sat.own.get<GilbertElliottConfig>().r, 0.25);
  EXPECT_EQ(sat.fixed.delay_ms, 270.0);
  EXPECT_EQ(s.get<ChannelSettings>().links.at("lan").fixed.prr,
            1.0);  // channel.X: uplink and downlink only
  const std::string text = to_toml(s);
  EXPECT_THAT(text, HasSubstr("loss = 0.25"));
  EXPECT_THAT(text, AllOf(HasSubstr("[channel.links.lan]\n"), HasSubstr("[channel.links.sat]\n")));
  const Scenario again = parse(text);
  EXPECT_EQ(to_toml(again), text);
  EXPECT_EQ(again.get<ChannelSettings>().links.size(), 3U);
}

TEST(ScenarioChannel, WhatIsWrongWithLinksByNameIsRefused) {
  const Refused cases[] = {
      {"[channel.links.sat]\nprx = 1",
       "\"channel.links.sat.prx\" (did you mean "
       "\"channel.links.sat.prr\"?"},
      {"[channel.links.sat]\nprr = 2",
       "channel.links.sat.prr = 2 is not allowed: must be a number in"},
      {"[channel.links.sat]\nmodel = \"chain\"\nprr = 0.5",
       "channel.links.sat.prr has no effect: channel.links.sat.model is \"chain\""},
      {"[channel.links.sat]\nmodel = \"chain\"", "needs channel.links.sat.chain.prr"},
      {"[channel.links]\nsat = 3", "unknown key \"channel.links.sat\""},
      {"[channel.links.\"a b\"]\nprr = 1", "link name \"a b\" is not allowed: must be letters"},
      {"[channel.links.Uplink]", "link name \"Uplink\" is not allowed: channel NET/UPLINK has"},
      {"[channel.links.counters]", "channel NET/COUNTERS has another meaning"},
      {"[channel.links.set]", "channel NET/SET has another meaning"},
      {"[channel.links.sat]\n[channel.links.SAT]", "only in case: both would report on NET/SAT"}};
  for (const Refused& c : cases) {
    EXPECT_THAT(section_refusal(c.lines), AllOf(HasSubstr("test.toml:"), HasSubstr(c.message)))
        << c.lines;
  }
  EXPECT_THAT(section_refusal("", {"channel.links.sat.prx=1"}), HasSubstr("channel.links.sat.prr"));
  EXPECT_EQ(section_refusal("[channel.links]"), "accepted");
}

TEST(ScenarioChannel, NamesOfFilesStartFromTheScenario) {
  const std::string text = "[channel.uplink.jitter]\nlaw = \"table\"\nfile = \"../delays.txt\"";
  EXPECT_EQ(parse_scenario(text, "scenarios/a.toml")
                .get<ChannelSettings>()
                .uplink.own.get<JitterSettings>()
                .file,
            "delays.txt");
}

struct ScenarioSojournTimes : testing::Test {
  std::string markov(const std::string& keys) {
    return "[channel.uplink]\nmodel = \"markov\"\n[channel.uplink.markov]\n" + keys;
  }
  static const MarkovConfig& uplink_markov(const Scenario& s) {
    return s.get<ChannelSettings>().uplink.own.get<MarkovConfig>();
  }
};

TEST_F(ScenarioSojournTimes, FollowFromTheStationaryProbabilityAndTheCycle) {
  const Scenario s = parse(markov("p_bad = 0.25\nmean_cycle_s = 8.0"));
  EXPECT_DOUBLE_EQ(uplink_markov(s).mean_bad_s, 2.0);
  EXPECT_DOUBLE_EQ(uplink_markov(s).mean_good_s, 6.0);
}

TEST_F(ScenarioSojournTimes, AreWhatTheResolvedScenarioHolds) {
  const Scenario s = parse(markov("p_bad = 0.3\nmean_cycle_s = 0.7"));
  EXPECT_THAT(to_toml(s), AllOf(Not(HasSubstr("p_bad")), Not(HasSubstr("mean_cycle_s"))));
  EXPECT_EQ(to_toml(parse(to_toml(s))), to_toml(s));
}

TEST_F(ScenarioSojournTimes, OneOfProbabilityAndCycleKeepsTheOther) {
  // The defaults are 24 s good and 8 s bad: P[bad] = 0.25 in a cycle of 32 s.
  const Scenario other_share = parse_scenario(markov("p_bad = 0.5"), "test.toml");
  EXPECT_DOUBLE_EQ(uplink_markov(other_share).mean_bad_s, 16.0);
  EXPECT_DOUBLE_EQ(uplink_markov(other_share).mean_good_s, 16.0);
  const Scenario other_cycle = parse_scenario(markov("mean_cycle_s = 4.0"), "test.toml");
  EXPECT_DOUBLE_EQ(uplink_markov(other_cycle).mean_bad_s, 1.0);
  EXPECT_DOUBLE_EQ(uplink_markov(other_cycle).mean_good_s, 3.0);
}

TEST_F(ScenarioSojournTimes, AnOverrideBeatsTheFileInEitherForm) {
  const Scenario by_share = parse_scenario(markov("mean_good_s = 6.0\nmean_bad_s = 2.0"),
                                           "test.toml", {"channel.uplink.markov.p_bad=0.5"});
  EXPECT_DOUBLE_EQ(uplink_markov(by_share).mean_bad_s, 4.0);
  const Scenario by_time = parse_scenario(markov("p_bad = 0.25\nmean_cycle_s = 8.0"), "test.toml",
                                          {"channel.uplink.markov.mean_bad_s=5"});
  EXPECT_DOUBLE_EQ(uplink_markov(by_time).mean_bad_s, 5.0);
  EXPECT_DOUBLE_EQ(uplink_markov(by_time).mean_good_s, 6.0);
}

TEST_F(ScenarioSojournTimes, AreGivenInOneWayOnly) {
  for (const char* other : {"mean_good_s = 6.0", "mean_bad_s = 2.0"}) {
    EXPECT_THAT(section_refusal(markov("p_bad = 0.25\nmean_cycle_s = 8.0\n" + std::string(other))),
                AllOf(StartsWith("test.toml: give either "), HasSubstr("markov.p_bad"),
                      HasSubstr("channel.uplink.markov.mean_good_s")));
  }
}

TEST_F(ScenarioSojournTimes, ThatFollowAreLimitedAsIfTheyHadBeenGiven) {
  EXPECT_THAT(section_refusal(markov("p_bad = 0.001\nmean_cycle_s = 0.5")),
              AllOf(HasSubstr("channel.uplink.markov.mean_bad_s = 0.0005"),
                    HasSubstr("must be a number in [0.001, 1000000000]")));
}

}  // namespace
}  // namespace tether
