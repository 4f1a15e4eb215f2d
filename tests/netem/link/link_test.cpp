#include "netem/link/link.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "netem/channel/settings.hpp"
#include "netem/models/state_process.hpp"
#include "netem/relay/make_links.hpp"
#include "tests/netem/stages/stage_rig.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::expect_balance;
using test::pop;
using test::VirtualWorld;

Packet packet(std::uint8_t value) { return {"CTRL/POSE", {value}}; }

Link fixed_link(double prr, double delay_ms, int queue_limit = 1000) {
  return test::link_with({"queue_limit=" + std::to_string(queue_limit)},
                         {prr, from_seconds(delay_ms * 1e-3)});
}

// ---------------------------------------------------------------------------- state process

TEST(StateProcess, FixedStaysGoodForever) {
  StateProcess s = StateProcess::fixed();
  s.advance(at_s(1e6));
  EXPECT_EQ(s.state(), StateProcess::kGood);
  EXPECT_EQ(s.next_transition(), Instant::max());
}

TEST(StateProcess, ChangesExactlyAtTheTransition) {
  StateProcess s = StateProcess::markov(1.0, 1.0, random_stream(1, "state"));
  const int before = s.state();
  const Instant change = s.next_transition();
  s.advance(change - Duration{1});
  EXPECT_EQ(s.state(), before);
  s.advance(change);
  EXPECT_NE(s.state(), before);
  EXPECT_GT(s.next_transition(), change);
}

TEST(StateProcess, DoesNotDependOnHowOftenItIsAsked) {
  StateProcess often = StateProcess::markov(0.7, 0.3, random_stream(3, "state"));
  StateProcess once = StateProcess::markov(0.7, 0.3, random_stream(3, "state"));
  for (double t = 0.0; t < 500.0; t += 0.01) often.advance(at_s(t));
  once.advance(at_s(499.99));
  EXPECT_EQ(often.state(), once.state());
  EXPECT_EQ(often.next_transition(), once.next_transition());
}

TEST(StateProcess, TimeNeverGoesBack) {
  StateProcess s = StateProcess::markov(1.0, 1.0, random_stream(1, "state"));
  s.advance(at_s(100));
  const Instant next = s.next_transition();
  s.advance(at_s(1));
  EXPECT_EQ(s.next_transition(), next);
}

TEST(StateProcess, SojournTimesHaveTheConfiguredMeansAndAreExponential) {
  constexpr int kSojourns = 20000;
  StateProcess s = StateProcess::markov(24.0, 8.0, random_stream(5, "state"));
  double sum_s[2] = {0.0, 0.0};
  int count[2] = {0, 0}, longer_than_mean[2] = {0, 0};
  const double mean_s[2] = {24.0, 8.0};
  s.advance(s.next_transition());
  for (int i = 0; i < 2 * kSojourns; ++i) {
    const int state = s.state();
    const Instant begin = s.next_transition();
    s.advance(begin);
    const double sojourn_s = to_seconds(s.next_transition() - begin);
    const int next_state = 1 - state;
    sum_s[next_state] += sojourn_s;
    longer_than_mean[next_state] += sojourn_s > mean_s[next_state] ? 1 : 0;
    ++count[next_state];
  }
  for (int state : {StateProcess::kGood, StateProcess::kBad}) {
    // Exponential: standard deviation = mean; P[X > mean] = 1/e. Tolerances: 4 standard errors.
    EXPECT_NEAR(sum_s[state] / count[state], mean_s[state],
                4.0 * mean_s[state] / std::sqrt(count[state]));
    const double p = std::exp(-1.0);
    EXPECT_NEAR(static_cast<double>(longer_than_mean[state]) / count[state], p,
                4.0 * std::sqrt(p * (1.0 - p) / count[state]));
  }
}

TEST(StateProcess, StartsFromTheStationaryDistribution) {
  constexpr int kSeeds = 4000;
  int bad = 0;
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    bad += StateProcess::markov(24.0, 8.0, random_stream(seed, "state")).state();
  }
  // Binomial with p = 0.25: 4 standard deviations.
  EXPECT_NEAR(bad, 0.25 * kSeeds, 4.0 * std::sqrt(kSeeds * 0.25 * 0.75));
}

// ---------------------------------------------------------------------------- link

TEST(Link, ZeroDelayPacketsLeaveAtTheInstantTheyArrive) {
  Link link = fixed_link(1.0, 0.0);
  EXPECT_EQ(link.push(at_ms(5), packet(7)), at_ms(5));
  EXPECT_EQ(link.next_event(), at_ms(5));
  EXPECT_EQ(pop(link, at_ms(5)), std::vector<int>{7});
  EXPECT_EQ(link.next_event(), Instant::max());
}

TEST(Link, DelayedPacketsLeaveExactlyOnTime) {
  Link link = fixed_link(1.0, 250.0);
  link.push(at_s(1), packet(7));
  EXPECT_EQ(link.next_event(), at_s(1.25));
  EXPECT_TRUE(pop(link, at_s(1.25) - Duration{1}).empty());
  EXPECT_EQ(pop(link, at_s(1.25)), std::vector<int>{7});
  EXPECT_EQ(link.delays().quantile(0.5), std::chrono::milliseconds{250});
}

TEST(Link, PacketsOfOneDelayKeepTheirOrder) {
  Link link = fixed_link(1.0, 10.0);
  for (std::uint8_t i = 0; i < 50; ++i) link.push(at_ms(1), packet(i));
  std::vector<int> expected(50);
  for (int i = 0; i < 50; ++i) expected[static_cast<std::size_t>(i)] = i;
  EXPECT_EQ(pop(link, at_ms(11)), expected);
}

TEST(Link, PacketsOvertakeWhenTheDelayFalls) {
  auto state =
      std::make_shared<StateProcess>(StateProcess::markov(1.0, 1.0, random_stream(2, "state")));
  while (state->state() != StateProcess::kBad) state->advance(state->next_transition());
  const Instant good_from = state->next_transition();
  const LinkCondition good{}, bad{1.0, std::chrono::milliseconds{500}};
  const auto streams = [](std::string_view purpose) { return random_stream(1, purpose); };
  Link link(make_stages(LinkConfig{}, "", streams),
            std::make_shared<MarkovProcess>(state, std::array{good, bad}));
  link.push(good_from - Duration{1}, packet(1));  // in the bad state: 500 ms
  link.push(good_from, packet(2));                // in the good state: at once
  EXPECT_EQ(pop(link, good_from), std::vector<int>{2});
  EXPECT_EQ(pop(link, good_from + std::chrono::seconds{1}), std::vector<int>{1});
}

TEST(Link, PrrOneLosesNothingAndPrrZeroEverything) {
  Link perfect = fixed_link(1.0, 0.0, 20000), dead = fixed_link(0.0, 0.0);
  for (int i = 0; i < 10000; ++i) {
    perfect.push(at_ms(i), packet(0));
    EXPECT_EQ(dead.push(at_ms(i), packet(0)), Instant::max());
  }
  EXPECT_EQ(perfect.counters().lost, 0);
  EXPECT_EQ(dead.counters().lost, 10000);
  expect_balance(perfect);
  expect_balance(dead);
}

TEST(Link, LossRateIsOneMinusPrr) {
  constexpr int kPackets = 100000;
  for (double prr : {0.1, 0.45, 0.9}) {
    Link link = fixed_link(prr, 0.0, kPackets);
    for (int i = 0; i < kPackets; ++i) link.push(kStart, packet(0));
    // Binomial: 4 standard deviations.
    EXPECT_NEAR(static_cast<double>(link.counters().lost), (1.0 - prr) * kPackets,
                4.0 * std::sqrt(kPackets * prr * (1.0 - prr)));
  }
}

TEST(Link, APacketThatSurvivesALowPrrSurvivesAHigherOne) {
  Link low = fixed_link(0.4, 0.0, 20000), high = fixed_link(0.7, 0.0, 20000);
  for (int i = 0; i < 10000; ++i) {
    const bool survives_low = low.push(kStart, packet(0)) != Instant::max();
    const bool survives_high = high.push(kStart, packet(0)) != Instant::max();
    EXPECT_TRUE(survives_high || !survives_low) << "packet " << i;
  }
}

TEST(Link, AFullQueueDropsTheNewestAndCountsIt) {
  Link link = fixed_link(1.0, 100.0, 2);
  for (std::uint8_t i = 0; i < 5; ++i) link.push(kStart, packet(i));
  EXPECT_EQ(link.counters().overflowed, 3);
  EXPECT_EQ(link.in_flight(), 2);
  expect_balance(link);
  EXPECT_EQ(pop(link, at_s(1)), (std::vector<int>{0, 1}));
  expect_balance(link);
}

TEST(MakeLinks, LinksHaveIndependentFates) {
  Scenario scenario;
  scenario.get<ChannelSettings>().uplink.fixed.prr =
      scenario.get<ChannelSettings>().downlink.fixed.prr = 0.5;
  LinkPair links = make_links(scenario);
  constexpr int kPackets = 10000;
  int same = 0;
  for (int i = 0; i < kPackets; ++i) {
    same += (links.uplink.push(kStart, packet(0)) == Instant::max()) ==
            (links.downlink.push(kStart, packet(0)) == Instant::max());
  }
  EXPECT_NEAR(same, kPackets / 2, 4.0 * std::sqrt(kPackets * 0.25));
}

TEST(MakeLinks, SharedStateIsOneProcessIndependentStateAreTwo) {
  Scenario scenario;
  scenario.get<ChannelSettings>().uplink.model = scenario.get<ChannelSettings>().downlink.model =
      "markov";
  for (bool shared : {false, true}) {
    scenario.get<ChannelSettings>().shared_state = shared;
    LinkPair links = make_links(scenario);
    EXPECT_EQ(
        links.uplink.process().next_transition() == links.downlink.process().next_transition(),
        shared);
  }
}

TEST(MakeLinks, TheDownlinksFateDoesNotDependOnTheUplinksModel) {
  Scenario plain;
  plain.get<ChannelSettings>().downlink.fixed.prr = 0.5;
  Scenario other = plain;
  other.get<ChannelSettings>().uplink.model = "markov";
  LinkPair a = make_links(plain), b = make_links(other);
  for (int i = 0; i < 1000; ++i) {
    b.uplink.push(at_ms(i), packet(0));
    EXPECT_EQ(a.downlink.push(at_ms(i), packet(0)), b.downlink.push(at_ms(i), packet(0)));
  }
}

// ---------------------------------------------------------------------------- delay histogram

TEST(DelayHistogram, IsZeroWhenEmpty) {
  DelayHistogram h;
  EXPECT_EQ(h.quantile(0.5), Duration{0});
  EXPECT_EQ(h.mean(), Duration{0});
}

TEST(DelayHistogram, ReportsAConstantExactly) {
  DelayHistogram h;
  for (int i = 0; i < 1000; ++i) h.add(std::chrono::microseconds{123457});
  EXPECT_EQ(h.quantile(0.01), std::chrono::microseconds{123457});
  EXPECT_EQ(h.quantile(0.99), std::chrono::microseconds{123457});
  EXPECT_EQ(h.mean(), std::chrono::microseconds{123457});
}

TEST(DelayHistogram, QuantilesAreWithinABinsWidth) {
  DelayHistogram h;
  for (int i = 1; i <= 100000; ++i) h.add(std::chrono::microseconds{i});
  for (double q : {0.01, 0.1, 0.5, 0.9, 0.99, 1.0}) {
    EXPECT_NEAR(static_cast<double>(h.quantile(q).count()), q * 1e8, q * 1e8 / 64.0);
  }
}

TEST(DelayHistogram, TakesTheExtremes) {
  DelayHistogram h;
  h.add(Duration{-5});
  h.add(Duration::max());
  EXPECT_EQ(h.quantile(0.5), Duration{0});
  EXPECT_EQ(h.max(), Duration::max());
}

}  // namespace
}  // namespace tether
