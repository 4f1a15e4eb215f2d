#include <gmock/gmock.h>

#include <algorithm>
#include <string>
#include <vector>

#include "netem/models/state_process.hpp"
#include "tests/netem/link/channel_rig.hpp"
#include "tests/netem/stages/stage_rig.hpp"

// Other settings for links in use: what becomes another and what stays as it was.

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::channel;
using test::ChannelRig;
using test::different;
using test::expect_same;
using test::pop;
using test::Settings;
using test::uplink_fates;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr int kChange = 1000;
constexpr int kPacketsInAll = 3000;

Settings operator+(Settings a, const Settings& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

const Settings kMarkov{"uplink.model=markov", "uplink.markov.mean_good_s=0.3",
                       "uplink.markov.mean_bad_s=0.1", "uplink.markov.bad.delay_ms=30"};
const Settings kOn{"uplink.loss=0.2",
                   "uplink.corrupt.probability=0.2",
                   "uplink.duplicate.probability=0.3",
                   "uplink.reorder.probability=0.2",
                   "uplink.slot.period_ms=20",
                   "uplink.outages=[[0.5, 0.7], [1.5, 1.6]]",
                   "uplink.jitter.law=gamma",
                   "uplink.jitter.mean_ms=8",
                   "uplink.jitter.sd_ms=4"};
const Settings kOff{"uplink.loss=0",
                    "uplink.corrupt.probability=0",
                    "uplink.duplicate.probability=0",
                    "uplink.reorder.probability=0",
                    "uplink.slot.period_ms=0",
                    "uplink.outages=[]",
                    "uplink.jitter.law=none"};
const Settings kOther{"uplink.loss=0.4",
                      "uplink.corrupt.probability=0.5",
                      "uplink.corrupt.bits=3",
                      "uplink.duplicate.probability=0.1",
                      "uplink.reorder.probability=0.6",
                      "uplink.slot.period_ms=7",
                      "uplink.outages=[[2, 2.5]]",
                      "uplink.jitter.law=uniform",
                      "uplink.jitter.mean_ms=20",
                      "uplink.jitter.sd_ms=3"};

// ------------------------------------------------------------------- what each packet meets

TEST(Change, GivesEachPacketTheFateThatItsSettingsGiveItWhateverWasBefore) {
  const auto on = uplink_fates(kMarkov + kOn), other = uplink_fates(kMarkov + kOther);
  const auto off = uplink_fates(kMarkov);
  ASSERT_GT(different(on, other, kChange, kPacketsInAll), 1000);
  ASSERT_GT(different(on, off, kChange, kPacketsInAll), 1000);

  const auto switched_on = uplink_fates(kMarkov, {{kChange, kOn}});
  expect_same(switched_on, off, 0, kChange);
  expect_same(switched_on, on, kChange, kPacketsInAll);

  const auto changed = uplink_fates(kMarkov + kOn, {{kChange, kOther}});
  expect_same(changed, on, 0, kChange);
  expect_same(changed, other, kChange, kPacketsInAll);

  const auto paused = uplink_fates(kMarkov + kOn, {{kChange, kOff}, {2000, kOn}});
  expect_same(paused, on, 0, kChange);
  expect_same(paused, off, kChange, 2000);
  expect_same(paused, on, 2000, kPacketsInAll);
}

TEST(Change, ToWhatIsInForceChangesNothing) {
  const Settings slots{"uplink.slot.packets=1", "uplink.jitter.correlation=0.8",
                       "uplink.rate.bits_per_s=2e5"};
  const Settings all = kMarkov + kOn + slots;
  expect_same(uplink_fates(all, {{kChange, all}, {1234, {"downlink.prr=0.3"}}}), uplink_fates(all),
              0, kPacketsInAll);
}

TEST(Change, OfTheJitterGoesOnWithTheNormalScores) {
  const Settings law{"uplink.jitter.law=normal", "uplink.jitter.mean_ms=100",
                     "uplink.jitter.sd_ms=2", "uplink.jitter.correlation=0.9"};
  const auto plain = uplink_fates(law);
  const auto later = uplink_fates(law, {{kChange, {"uplink.jitter.mean_ms=130"}}});
  for (std::size_t n = 0; n < kPacketsInAll; ++n) {
    const Duration expected = n < kChange ? Duration{0} : from_seconds(0.03);
    EXPECT_NEAR(static_cast<double>((later[n].departure - plain[n].departure - expected).count()),
                0.0, 2.0);  // each delay is rounded to 1 ns
  }
}

// ------------------------------------------------------------------- models

std::vector<int> states(const std::vector<PacketFate>& fates) {
  std::vector<int> list;
  for (const PacketFate& fate : fates) list.push_back(fate.state);
  return list;
}

TEST(Change, OfAStatesConditionsOrOfAStageLeavesTheMarkovChainAlone) {
  const auto expected = states(uplink_fates(kMarkov));
  EXPECT_THAT(expected, ::testing::Contains(1));
  for (const Settings& settings :
       {Settings{"uplink.markov.bad.prr=0.1"}, Settings{"uplink.markov.good.delay_ms=5"},
        Settings{"uplink.jitter.law=normal", "uplink.jitter.sd_ms=1"}, Settings{"uplink.loss=1"}}) {
    const auto fates = uplink_fates(kMarkov, {{kChange, settings}});
    EXPECT_EQ(states(fates), expected) << settings[0];
  }
}

TEST(Change, OfSojournTimesGivesTheStatesOfARunThatHadThemFromTheStart) {
  const Settings slow{"uplink.markov.mean_good_s=0.7", "uplink.markov.mean_bad_s=0.4"};
  const auto changed = uplink_fates(kMarkov, {{kChange, slow}});
  expect_same(changed, uplink_fates(kMarkov), 0, kChange);
  expect_same(changed, uplink_fates(kMarkov + slow), kChange, kPacketsInAll);
}

TEST(Change, OfTheModelThereAndBackMeetsTheSameChannelAgain) {
  const auto chain = Settings{"uplink.model=chain", "uplink.chain.prr=[1.0, 0.2]",
                              "uplink.chain.rates_per_s=[[0, 5], [9, 0]]"};
  for (const Settings& model : {kMarkov, chain}) {
    const auto plain = uplink_fates(model);
    const auto fates =
        uplink_fates(model, {{kChange, {"uplink.model=fixed"}}, {2000, {model.front()}}});
    expect_same(fates, plain, 0, kChange);
    expect_same(fates, uplink_fates({}), kChange, 2000);
    expect_same(fates, plain, 2000, kPacketsInAll);
  }
}

TEST(Change, OfProbabilitiesPerPacketGoesOnInTheStateAndWithTheStream) {
  const Settings gilbert{"uplink.model=gilbert_elliott", "uplink.gilbert_elliott.p=0.02",
                         "uplink.gilbert_elliott.r=0.02"};
  const auto plain = uplink_fates(gilbert);
  // The chain's next draw decides on a step: only the losses in the states differ.
  const auto lossless =
      uplink_fates(gilbert, {{kChange, {"uplink.gilbert_elliott.one_minus_h=0"}}});
  EXPECT_EQ(states(lossless), states(plain));
  expect_same(lossless, plain, 0, kChange);
  const auto delayed = uplink_fates(gilbert, {{kChange, {"uplink.delay_ms=10"}}});
  EXPECT_EQ(states(delayed), states(plain));
  // In the state that it is in, whichever that is, it now stays.
  for (const int when : {500, 1000, 1500, 2000, 2500}) {
    const auto stuck = uplink_fates(
        gilbert, {{when, {"uplink.gilbert_elliott.p=0", "uplink.gilbert_elliott.r=0"}}});
    const auto at = static_cast<std::size_t>(when);
    EXPECT_EQ(stuck[at].state, plain[at - 1].state) << when;
    EXPECT_EQ(stuck.back().state, stuck[at].state) << when;
  }
}

TEST(Change, ToAModelPerPacketBeginsWithTheDrawsOfThePacketsNumber) {
  // Where p + r = 1, draws between 0.3 and 0.7 lead to the good state from both.
  const Settings gilbert{"uplink.model=gilbert_elliott", "uplink.gilbert_elliott.p=0.3",
                         "uplink.gilbert_elliott.r=0.7"};
  const auto plain = uplink_fates(gilbert);
  const auto fates = uplink_fates(
      gilbert, {{kChange, {"uplink.model=fixed"}}, {2000, {"uplink.model=gilbert_elliott"}}});
  expect_same(fates, uplink_fates({}), kChange, 2000);
  expect_same(fates, plain, 2100, kPacketsInAll);
}

TEST(Change, OfASharedStateIsForBothLinksOrNone) {
  const Settings shared{"shared_state=true", "model=markov", "markov.mean_good_s=0.3",
                        "markov.mean_bad_s=0.1"};
  ChannelRig rig(channel(shared));
  EXPECT_THAT(rig.refusal({"uplink.markov.mean_bad_s=0.2"}), HasSubstr("same sojourn times"));
  EXPECT_THAT(rig.refusal({"downlink.model=fixed"}), HasSubstr("same model"));
  EXPECT_THAT(
      rig.refusal({"model=gilbert_elliott", "gilbert_elliott.p=0.1", "gilbert_elliott.r=0.1"}),
      HasSubstr("moves in time"));
  rig.change({"markov.mean_good_s=0.2", "markov.mean_bad_s=0.2"}, at_s(1));
  StateProcess expected =
      StateProcess::markov(0.2, 0.2, link_streams(rig.control.in_force(), "uplink")("state"));
  for (double t = 1.0; t < 20.0; t += 0.01) {
    expected.advance(at_s(t));
    rig.links.downlink.process().advance(at_s(t));
    ASSERT_EQ(rig.links.downlink.process().state(), expected.state()) << t;
    ASSERT_EQ(rig.links.uplink.process().state(), expected.state()) << t;
  }
  rig.change({"shared_state=false"}, at_s(20));
  StateProcess own =
      StateProcess::markov(0.2, 0.2, link_streams(rig.control.in_force(), "downlink")("state"));
  for (double t = 20.0; t < 40.0; t += 0.01) {
    own.advance(at_s(t)), expected.advance(at_s(t));
    for (Link* link : {&rig.links.uplink, &rig.links.downlink}) link->process().advance(at_s(t));
    ASSERT_EQ(rig.links.uplink.process().state(), expected.state()) << t;
    ASSERT_EQ(rig.links.downlink.process().state(), own.state()) << t;
  }
}

TEST(Map, BothDirectionsMeetTheSameShadowingAndEachPacketItsOwnLuck) {
  ChannelRig rig(channel({"model=map", "map.access_points=[[0, 0], [80, 0]]",
                          "map.shadowing_sd_db=8", "map.snr50_db=22"}));
  ChannelProcess &up = rig.links.uplink.process(), &down = rig.links.downlink.process();
  ASSERT_NE(&up, &down);
  double least = 1.0, most = 0.0;
  for (int i = 0; i < 200; ++i) {
    up.on_position(i, 0.5 * i, at_ms(i));
    down.on_position(i, 0.5 * i, at_ms(i));
    EXPECT_EQ(up.condition(), down.condition());
    least = std::min(least, up.condition().prr);
    most = std::max(most, up.condition().prr);
  }
  EXPECT_LT(least, 0.2);
  EXPECT_GT(most, 0.8);
  rig.change({"map.prr_curve=[[-100, 0.5], [100, 0.5]]"}, at_ms(200));
  int apart = 0;
  for (int i = 0; i < 100; ++i) {
    const bool up_lost = rig.links.uplink.push(at_ms(201 + i), {"X", {}}) == Instant::max();
    const bool down_lost = rig.links.downlink.push(at_ms(201 + i), {"X", {}}) == Instant::max();
    apart += up_lost != down_lost ? 1 : 0;
  }
  EXPECT_NEAR(apart, 50, 25);  // binomial, 5 standard deviations
}

TEST(Change, OfAMapKnowsWhereTheVehicleIs) {
  ChannelRig rig(channel({"uplink.model=map", "uplink.map.access_points=[[0, 0]]"}));
  rig.links.uplink.process().on_position(30.0, 0.0, at_s(1));
  ChannelRig there(
      channel({"uplink.model=map", "uplink.map.access_points=[[0, 0]]", "uplink.map.snr50_db=14"}));
  there.links.uplink.process().on_position(30.0, 0.0, at_s(1));
  rig.change({"uplink.map.snr50_db=14"}, at_s(2));
  EXPECT_EQ(rig.links.uplink.process().condition(), there.links.uplink.process().condition());
  EXPECT_GT(rig.links.uplink.process().condition().prr, 0.01);
  EXPECT_LT(rig.links.uplink.process().condition().prr, 0.99);
}

// ------------------------------------------------------------------- packets under way

TEST(Change, LeavesPacketsUnderWayAndCountersAlone) {
  ChannelRig rig(channel({"uplink.delay_ms=500"}));
  Link& link = rig.links.uplink;
  EXPECT_EQ(link.push(at_ms(0), {"X", {1}}), at_ms(500));
  rig.change({"uplink.delay_ms=10", "uplink.queue_limit=1"}, at_ms(100));
  EXPECT_EQ(link.next_event(), at_ms(500));
  EXPECT_EQ(link.push(at_ms(100), {"X", {2}}), Instant::max());  // no room
  rig.change({"uplink.queue_limit=9"}, at_ms(200));
  EXPECT_EQ(link.push(at_ms(200), {"X", {3}}), at_ms(210));
  EXPECT_THAT(pop(link, at_ms(499)), ElementsAre(3));
  EXPECT_THAT(pop(link, at_ms(500)), ElementsAre(1));
  EXPECT_EQ(link.counters().offered, 3);
  EXPECT_EQ(link.counters().overflowed, 1);
  EXPECT_EQ(link.counters().delivered, 2);
  EXPECT_EQ(link.delays().max(), at_ms(500) - at_ms(0));
}

TEST(Change, ToInOrderLetsNoPacketOvertakeThoseUnderWay) {
  ChannelRig rig(channel({"uplink.delay_ms=500"}));
  rig.links.uplink.push(at_ms(0), {"X", {1}});
  rig.change({"uplink.delay_ms=10", "uplink.in_order=true"}, at_ms(100));
  EXPECT_EQ(rig.links.uplink.push(at_ms(100), {"X", {2}}), at_ms(500));
  EXPECT_EQ(rig.links.uplink.push(at_ms(495), {"X", {3}}), at_ms(505));
}

TEST(Change, OfTheRateCountsForPacketsThatComeBehindThoseThatWait) {
  ChannelRig rig(channel({"uplink.rate.bits_per_s=8000"}));  // 1 byte a millisecond
  const auto push = [&](int t_ms) {
    return rig.links.uplink.push(at_ms(t_ms), {"X", std::vector<std::uint8_t>(100)});
  };
  EXPECT_EQ(push(0), at_ms(100));
  rig.change({"uplink.rate.bits_per_s=16000"}, at_ms(10));
  EXPECT_EQ(push(10), at_ms(150));
  rig.change({"uplink.rate.queue_packets=2"}, at_ms(20));
  EXPECT_EQ(push(20), Instant::max());
  rig.change({"uplink.rate.bits_per_s=0"}, at_ms(30));
  EXPECT_EQ(push(30), at_ms(30));
}

}  // namespace
}  // namespace tether
