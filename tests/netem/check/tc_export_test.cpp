#include "netem/fit/tc_export.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "netem/channel/settings.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using Keys = std::vector<std::string>;

TcExport exported(Keys keys) {
  for (std::string& key : keys) key = "channel.uplink." + key;
  return export_tc(parse_scenario("", "test", keys).get<ChannelSettings>().uplink,
                   {"eth0", "AGV/POSE", 0.05});
}

/// The options behind "tc qdisc add dev eth0 root netem".
std::string options(const Keys& keys) {
  const std::string command = exported(keys).command;
  const std::string begin = "tc qdisc add dev eth0 root netem ";
  EXPECT_EQ(command.substr(0, begin.size()), begin);
  return command.substr(begin.size());
}

std::vector<std::string> notes(const Keys& keys) { return exported(keys).notes; }

TEST(TcExport, APerfectLinkIsAQueue) {
  EXPECT_EQ(options({}), "limit 100000");
  EXPECT_THAT(notes({}), IsEmpty());
  EXPECT_EQ(options({"queue_limit=7"}), "limit 7");
  EXPECT_EQ(options({"queue_limit=99999999999"}), "limit 4294967295");
}

TEST(TcExport, IndependentLossComposesWithTheModels) {
  EXPECT_EQ(options({"prr=0.45", "delay_ms=100"}), "delay 100ms limit 100000 loss random 55%");
  EXPECT_EQ(options({"prr=0.9", "loss=0.5"}), "limit 100000 loss random 55%");
  EXPECT_EQ(options({"loss=0.125"}), "limit 100000 loss random 12.5%");
  EXPECT_EQ(options({"prr=0"}), "limit 100000 loss random 100%");
  EXPECT_THAT(notes({"prr=0.9", "loss=0.5", "delay_ms=0.25"}), IsEmpty());
}

TEST(TcExport, GilbertAndElliottsIsGemodel) {
  const Keys simple{"model=gilbert_elliott", "gilbert_elliott.prr=0.8",
                    "gilbert_elliott.mean_burst=4", "delay_ms=20"};
  EXPECT_EQ(options(simple), "delay 20ms limit 100000 loss gemodel 6.25% 25% 100% 0%");
  EXPECT_EQ(options({"model=gilbert_elliott", "gilbert_elliott.p=0.01", "gilbert_elliott.r=0.1",
                     "gilbert_elliott.one_minus_h=0.75", "gilbert_elliott.one_minus_k=0.001",
                     "loss=0.2"}),
            "limit 100000 loss gemodel 1% 10% 80% 20.08%");
  EXPECT_THAT(notes(simple), IsEmpty());
}

TEST(TcExport, FourStatesAreLossState) {
  const Keys full{"model=four_state",   "four_state.p13=0.02", "four_state.p31=0.3",
                  "four_state.p32=0.2", "four_state.p23=0.5",  "four_state.p14=0.01"};
  EXPECT_EQ(options(full), "limit 100000 loss state 2% 30% 20% 50% 1%");
  EXPECT_THAT(notes(full), IsEmpty());
  EXPECT_EQ(options({"model=four_state", "four_state.p13=0.25"}),
            "limit 100000 loss state 25% 75% 0% 100% 0%");
  Keys lossy = full;
  lossy.emplace_back("loss=0.1");
  EXPECT_EQ(options(lossy), options(full));
  EXPECT_THAT(notes(lossy), ElementsAre(HasSubstr("loss = 0.1 is left out")));
}

TEST(TcExport, AChainOfTwoStatesPerPacketIsGemodel) {
  const Keys two{"model=chain", "chain.prr=[0.99, 0.25]",
                 "chain.probabilities=[[0.95, 0.05], [0.2, 0.8]]", "chain.delay_ms=[7, 7]"};
  EXPECT_EQ(options(two), "delay 7ms limit 100000 loss gemodel 5% 20% 75% 1%");
  EXPECT_THAT(notes(two), IsEmpty());
  EXPECT_THAT(notes({"model=chain", "chain.prr=[1, 0.5, 0]",
                     "chain.probabilities=[[0, 1, 0], [0, 0, 1], [0.5, 0.5, 0]]"}),
              ElementsAre(HasSubstr("two states")));
}

TEST(TcExport, WhatMovesInTimeHasNoEquivalent) {
  const Keys markov{"model=markov",       "markov.mean_good_s=3",   "markov.mean_bad_s=1",
                    "markov.bad.prr=0.5", "markov.bad.delay_ms=10", "markov.good.delay_ms=10"};
  EXPECT_EQ(options(markov), "delay 10ms limit 100000");
  // p = (1/4)(1 − e^(−0.05·4/3)), r = 3p
  EXPECT_THAT(
      notes(markov),
      ElementsAre(HasSubstr("every 50 ms, \"loss gemodel 1.612325374% 4.836976123% 50% 0%\"")));
  EXPECT_THAT(notes({"model=chain", "chain.prr=[1, 0]", "chain.rates_per_s=[[0, 1], [1, 0]]"}),
              ElementsAre(HasSubstr("not with time")));
  EXPECT_THAT(notes({"model=chain", "chain.prr=[1, 0]", "chain.step_s=0.1",
                     "chain.probabilities=[[0, 1], [1, 0]]"}),
              ElementsAre(HasSubstr("not with time")));
  EXPECT_THAT(notes({"model=map", "map.access_points=[[0, 0]]"}),
              ElementsAre(HasSubstr("netem knows no position")));
}

TEST(TcExport, DelaysByStateAreLeftOut) {
  const Keys by_state{"model=chain", "chain.prr=[1, 1]", "chain.delay_ms=[1, 2]",
                      "chain.probabilities=[[0.5, 0.5], [0.5, 0.5]]"};
  EXPECT_EQ(options(by_state), "limit 100000 loss gemodel 50% 50% 0% 0%");
  EXPECT_THAT(notes(by_state), ElementsAre(HasSubstr("delays that depend on the state")));
}

Keys jitter(const std::string& law, const Keys& more = {}) {
  Keys keys{"jitter.law=" + law, "jitter.mean_ms=30", "jitter.sd_ms=12", "delay_ms=20"};
  keys.insert(keys.end(), more.begin(), more.end());
  return keys;
}

TEST(TcExport, JitterLawsKeepTheirStandardDeviation) {
  // J = √3·12, 12, 12·√3/2, 12/1.05177
  EXPECT_EQ(options(jitter("uniform")), "delay 50ms 20.78460969ms limit 100000");
  EXPECT_EQ(options(jitter("normal")), "delay 50ms 12ms distribution normal limit 100000");
  EXPECT_EQ(options(jitter("pareto")), "delay 50ms 10.39230485ms distribution pareto limit 100000");
  EXPECT_EQ(options(jitter("paretonormal")),
            "delay 50ms 11.40931768ms distribution paretonormal limit 100000");
  EXPECT_THAT(notes(jitter("uniform")), ElementsAre(HasSubstr("packets overtake each other")));
  EXPECT_THAT(notes(jitter("pareto")),
              ElementsAre(HasSubstr("J = sd/1.1547; tc's table ends at T -6.93 ms and +41.6 ms"),
                          HasSubstr("overtake")));
  EXPECT_EQ(options({"jitter.law=constant", "jitter.mean_ms=-5", "delay_ms=20"}),
            "delay 15ms limit 100000");
}

TEST(TcExport, JitterThatTcCannotDoIsNamed) {
  EXPECT_EQ(options(jitter("gamma")), "delay 50ms limit 100000");
  EXPECT_THAT(notes(jitter("gamma")), ElementsAre(HasSubstr("no table of gamma laws")));
  EXPECT_THAT(notes(jitter("pareto", {"jitter.shape=2.5"})),
              ElementsAre(HasSubstr("tail index 3")));
  EXPECT_EQ(options({"jitter.law=table", "jitter.table_ms=[1, 2]", "delay_ms=20"}),
            "delay 20ms limit 100000");
  EXPECT_THAT(notes(jitter("normal", {"jitter.correlation=0.5"})),
              ::testing::Contains(HasSubstr("jitter.correlation = 0.5 has no equivalent")));
  EXPECT_THAT(notes({"jitter.law=normal", "jitter.sd_ms=1"}),
              ElementsAre(HasSubstr("tc wants a delay")));
  EXPECT_THAT(notes({"jitter.law=uniform", "jitter.sd_ms=1", "jitter.mean_ms=-1"}),
              ElementsAre(HasSubstr("no negative delay")));
  EXPECT_THAT(notes({"jitter.law=normal", "jitter.sd_ms=2148", "jitter.mean_ms=9000"}),
              ElementsAre(HasSubstr("netem cuts J")));
}

TEST(TcExport, OrderNeedsARate) {
  EXPECT_EQ(options(jitter("uniform", {"in_order=true"})),
            "delay 50ms 20.78460969ms rate 100gbit limit 100000");
  EXPECT_THAT(notes(jitter("uniform", {"in_order=true"})),
              ElementsAre(HasSubstr("keep the order")));
  EXPECT_EQ(options({"delay_ms=50", "in_order=true"}), "delay 50ms limit 100000");
}

TEST(TcExport, TheRateLeavesOutTheHeadersThatTcCounts) {
  // 14 Ethernet + 20 IP + 8 UDP + 8 LCM + "AGV/POSE" and a zero
  EXPECT_EQ(options({"rate.bits_per_s=20000"}), "rate 20000bit -59 limit 1000");
  EXPECT_EQ(options({"rate.bits_per_s=20000", "rate.overhead_bytes=60", "rate.queue_packets=5"}),
            "rate 20000bit 1 limit 5");
  EXPECT_EQ(options({"rate.bits_per_s=20000", "delay_ms=10"}),
            "delay 10ms rate 20000bit -59 limit 100000");
  EXPECT_THAT(notes({"rate.bits_per_s=20000", "rate.queue_bytes=500"}),
              ElementsAre(HasSubstr("headers (59 bytes with AGV/POSE)"),
                          HasSubstr("rate.queue_bytes = 500 is left out")));
  EXPECT_THAT(
      notes({"rate.bits_per_s=20000", "delay_ms=10"}),
      ElementsAre(HasSubstr("headers"), HasSubstr("rate.queue_packets = 1000 is left out")));
  EXPECT_THAT(notes(jitter("uniform", {"rate.bits_per_s=20000"})),
              ::testing::Contains(HasSubstr("lets none overtake")));
}

TEST(TcExport, ReorderingNeedsADelay) {
  const Keys reorder{"delay_ms=10", "reorder.probability=0.25"};
  EXPECT_EQ(options(reorder), "delay 10ms reorder 25% limit 100000");
  EXPECT_THAT(notes(reorder), IsEmpty());
  EXPECT_EQ(options({"delay_ms=10", "reorder.probability=0.25", "reorder.gap=5"}),
            "delay 10ms reorder 25% gap 5 limit 100000");
  EXPECT_EQ(options({"reorder.probability=0.25"}), "limit 100000");
  EXPECT_THAT(notes({"reorder.probability=0.25"}), ElementsAre(HasSubstr("wants a delay")));
}

TEST(TcExport, CopiesAndDamageSayWhatDiffers) {
  EXPECT_EQ(options({"duplicate.probability=0.02"}), "limit 100000 duplicate 2%");
  EXPECT_THAT(notes({"duplicate.probability=0.02"}), IsEmpty());
  EXPECT_EQ(options({"prr=0.5", "duplicate.probability=0.02"}),
            "limit 100000 loss random 50% duplicate 2%");
  EXPECT_THAT(notes({"prr=0.5", "duplicate.probability=0.02"}),
              ElementsAre(HasSubstr("before the loss")));
  EXPECT_EQ(options({"corrupt.probability=0.1"}), "limit 100000 corrupt 10%");
  EXPECT_THAT(notes({"corrupt.probability=0.1", "corrupt.bits=3"}),
              ElementsAre(HasSubstr("flips one bit, not 3, anywhere")));
}

TEST(TcExport, SlotsAndOutagesHaveNoEquivalent) {
  EXPECT_EQ(options({"slot.period_ms=10", "outages=[[1, 2]]"}), "limit 100000");
  EXPECT_THAT(notes({"slot.period_ms=10", "slot.jitter_ms=2", "slot.packets=3"}),
              ElementsAre(HasSubstr("\"slot 10ms 12ms packets 3\"")));
  EXPECT_THAT(notes({"outages=[[1, 2]]"}), ElementsAre(HasSubstr("no schedule")));
}

}  // namespace
}  // namespace tether
