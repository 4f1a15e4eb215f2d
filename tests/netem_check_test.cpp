#include <gtest/gtest.h>

#include <boost/random/exponential_distribution.hpp>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "netem/channel_check.hpp"
#include "netem/channel_expectation.hpp"
#include "tests/loss_rig.hpp"

namespace tether {
namespace {

using testing::Chain;
using testing::covers;
using testing::expect_misses;
using testing::gilbert_elliott;
using testing::kIndependent;
using testing::kInterval;
using testing::record_of;
using testing::uniform;

// ------------------------------------------------------------- intervals cover what they promise

struct Model {
  const char* name;
  ChannelExpectation expected;
  std::function<Chain(std::uint64_t seed)> make;
};

std::vector<Model> models() {
  const GilbertElliott gilbert{0.02, 0.2, 1.0, 0.0}, elliott{0.01, 0.05, 0.6, 0.02};
  const GilbertElliott mostly_lost{0.2, 0.05, 1.0, 0.1};
  const FourState four{0.02, 0.3, 0.2, 0.5, 0.01};
  const auto make_four = [four](std::uint64_t seed) {
    return Chain{{{1.0 - four.p13 - four.p14, 0.0, four.p13, four.p14},
                  {0.0, 1.0 - four.p23, four.p23, 0.0},
                  {four.p31, four.p32, 1.0 - four.p31 - four.p32, 0.0},
                  {1.0, 0.0, 0.0, 0.0}},
                 {0.0, 0.0, 1.0, 1.0},
                 RandomEngine(seed),
                 0};
  };
  const auto of = [](const GilbertElliott& m) {
    return [m](std::uint64_t seed) { return gilbert_elliott(m, seed); };
  };
  return {{"rare, independent", ChannelExpectation::independent(0.99), of({0.0, 1.0, 1.0, 0.01})},
          {"Gilbert", ChannelExpectation::gilbert_elliott(gilbert), of(gilbert)},
          {"Gilbert-Elliott", ChannelExpectation::gilbert_elliott(elliott), of(elliott)},
          {"mostly lost", ChannelExpectation::gilbert_elliott(mostly_lost), of(mostly_lost)},
          {"four states", ChannelExpectation::four_state(four), make_four}};
}

TEST(LossIntervals, OfAKnownModelCoverTheTruthAsOftenAsTheySay) {
  constexpr int kRuns = 1000, kPackets = 10000;
  for (const Model& model : models()) {
    const ChannelExpectation& e = model.expected;
    int prr = 0, burst = 0, lag1 = 0;
    for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
      Chain chain = model.make(seed);
      const LossRecord r = record_of([&] { return chain.next_is_lost(); }, kPackets);
      prr += covers(r.prr(0.95, e.spread()), e.prr()) ? 0 : 1;
      burst += covers(r.mean_burst(0.95, e.spread()), e.mean_burst()) ? 0 : 1;
      lag1 += covers(r.lag1_correlation(0.95, e.spread()), e.lag1_correlation()) ? 0 : 1;
    }
    expect_misses(prr, model.name, "PRR");
    // 1 % independent loss has one double loss a run: discrete, so the interval is conservative.
    const bool discrete = model.name == std::string("rare, independent");
    if (!discrete) expect_misses(burst, model.name, "burst");
    if (!discrete) expect_misses(lag1, model.name, "lag 1");
    EXPECT_LE(std::max(burst, lag1), 84) << model.name;
  }
}

TEST(LossIntervals, WithoutVarianceInflationAreFarTooNarrow) {
  const GilbertElliott m{0.01, 0.05, 1.0, 0.0};  // VIF 32
  const double prr = ChannelExpectation::gilbert_elliott(m).prr();
  int misses = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Chain chain = gilbert_elliott(m, seed);
    const LossRecord r = record_of([&] { return chain.next_is_lost(); }, 10000);
    misses += covers(r.prr(0.95, kIndependent), prr) ? 0 : 1;
  }
  EXPECT_GT(misses, 100);  // P[|Z| > 1.96/√32] = 0.73
}

TEST(LossIntervals, OfAnUnknownChannelCoverTheTruthAsOftenAsTheySay) {
  constexpr int kRuns = 1000, kPackets = 20000;
  for (const Model& model : models()) {
    const ChannelExpectation& e = model.expected;
    int prr = 0, burst = 0, unreliable = 0;
    for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
      Chain chain = model.make(seed);
      const LossRecord r = record_of([&] { return chain.next_is_lost(); }, kPackets);
      const LossSpread spread = r.estimated_spread();
      prr += covers(r.prr(0.95, spread), e.prr()) ? 0 : 1;
      burst += covers(r.mean_burst(0.95, spread), e.mean_burst()) ? 0 : 1;
      unreliable += spread.reliable ? 0 : 1;
    }
    // Batch means of skewed fates miss a little more often: 6.5 % are granted, and 5 deviations.
    expect_misses(prr, model.name, "PRR", 104);
    EXPECT_LE(burst, 104) << model.name;
    EXPECT_LE(unreliable, 100) << model.name;  // 1 % by chance; batches are long
  }
}

TEST(LossIntervals, AdmitThatARunIsShortAgainstItsCorrelation) {
  const GilbertElliott slow{0.001, 0.001, 1.0, 0.0};  // sojourns of 1000 packets
  int unreliable = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    Chain chain = gilbert_elliott(slow, seed);
    const LossSpread s = record_of([&] { return chain.next_is_lost(); }, 8000).estimated_spread();
    unreliable += s.reliable ? 0 : 1;
  }
  EXPECT_GE(unreliable, 90);
}

// ---------------------------------------------------------------------------- verdicts

struct Outcome {
  LossRecord loss;
  DelayStatistics delays;
  SojournStatistics sojourns{2};
};

Outcome simulate(const GilbertElliott& m, Duration bad_delay, std::uint64_t seed, int packets) {
  Outcome result;
  Chain chain = gilbert_elliott(m, seed);
  for (int i = 0; i < packets; ++i) {
    result.sojourns.enter(chain.state, i);
    const bool bad = chain.state == 1, lost = chain.next_is_lost();
    result.loss.add(lost, kStart + i * kInterval);
    if (!lost) result.delays.add(bad ? bad_delay : Duration{0});
  }
  result.sojourns.advance(packets);
  return result;
}

std::vector<ChannelCheck> check(const GilbertElliott& configured, const Outcome& r,
                                double bad_delay_s, const ChannelCheckOptions& options = {}) {
  return compare_channel(ChannelExpectation::gilbert_elliott(configured, constant_delay(0.0),
                                                             constant_delay(bad_delay_s)),
                         r.loss, r.delays, &r.sojourns, options);
}

Verdict verdict_on(const std::vector<ChannelCheck>& checks, const std::string& quantity) {
  for (const ChannelCheck& c : checks) {
    if (c.quantity == quantity) return c.verdict;
  }
  ADD_FAILURE() << "no check of " << quantity;
  return Verdict::not_comparable;
}

const GilbertElliott kModel{0.02, 0.1, 0.7, 0.01};
constexpr Duration kBadDelay = std::chrono::milliseconds{80};

TEST(ChannelCheck, PassesARightChannel) {
  const auto checks = check(kModel, simulate(kModel, kBadDelay, 1, 200000), 0.08);
  EXPECT_EQ(checks.size(), 8U);
  for (const ChannelCheck& c : checks) EXPECT_EQ(c.verdict, Verdict::ok) << c.quantity;
  EXPECT_EQ(overall(checks), Verdict::ok);
}

TEST(ChannelCheck, RaisesFalseAlarmsNoMoreOftenThanItSays) {
  constexpr int kRuns = 1000;
  ChannelCheckOptions options;
  options.false_alarm = 0.1;
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
    const Outcome r = simulate(kModel, kBadDelay, seed, 5000);
    alarms += overall(check(kModel, r, 0.08, options)) == Verdict::outside ? 1 : 0;
  }
  EXPECT_LE(alarms, 0.1 * kRuns + 5.0 * std::sqrt(kRuns * 0.1 * 0.9));
  EXPECT_GT(alarms, 0);  // else the intervals would be far too wide
}

TEST(ChannelCheck, NoticesEachKindOfDeviation) {
  constexpr int kPackets = 200000;
  const auto with = [](auto change) {
    GilbertElliott m = kModel;
    change(m);
    return m;
  };
  const auto less_loss = with([](auto& m) { m.one_minus_h = 0.6; });
  EXPECT_EQ(verdict_on(check(kModel, simulate(less_loss, kBadDelay, 1, kPackets), 0.08), "PRR"),
            Verdict::outside);
  // The same PRR in bursts twice as long.
  const auto slower = with([](auto& m) { m.p /= 2, m.r /= 2; });
  const auto slow = check(kModel, simulate(slower, kBadDelay, 1, kPackets), 0.08);
  EXPECT_EQ(verdict_on(slow, "PRR"), Verdict::ok);
  EXPECT_EQ(verdict_on(slow, "mean loss burst"), Verdict::outside);
  EXPECT_EQ(verdict_on(slow, "lag-1 correlation"), Verdict::outside);
  EXPECT_EQ(verdict_on(slow, "mean sojourn (bad)"), Verdict::outside);
  // A delay that is wrong by 1 %.
  const auto late = check(kModel, simulate(kModel, kBadDelay * 101 / 100, 1, kPackets), 0.08);
  EXPECT_EQ(verdict_on(late, "delay p99"), Verdict::outside);
  EXPECT_EQ(verdict_on(late, "PRR"), Verdict::ok);
}

TEST(ChannelCheck, CallsAShortRunTooShort) {
  const auto checks = check(kModel, simulate(kModel, kBadDelay, 1, 500), 0.08);
  EXPECT_EQ(overall(checks), Verdict::too_short);
  EXPECT_EQ(verdict_on(checks, "PRR"), Verdict::too_short);
}

TEST(ChannelCheck, OneLossFromAPerfectChannelIsOutside) {
  LossRecord loss;
  DelayStatistics delays;
  for (int i = 0; i < 5000; ++i) {
    loss.add(i == 2500, kStart + i * kInterval);
    if (i != 2500) delays.add(Duration{0});
  }
  const auto expected = ChannelExpectation::independent(1.0);
  const auto checks = compare_channel(expected, loss, delays, nullptr);
  EXPECT_EQ(verdict_on(checks, "PRR"), Verdict::outside);
}

TEST(ChannelCheck, PredictsNoBurstsOfAProcessInTimeUnderIrregularTraffic) {
  LossRecord loss;
  RandomEngine random(1);
  boost::random::exponential_distribution<double> gap(20.0);
  Instant t = kStart;
  for (int i = 0; i < 20000; ++i) loss.add(uniform(random) < 0.3, t += from_seconds(gap(random)));
  const auto expected = ChannelExpectation::markov(1.0, 1.0, 0.05, {"good", 0.7}, {"bad", 0.7});
  const auto checks = compare_channel(expected, loss, {}, nullptr);
  EXPECT_EQ(verdict_on(checks, "PRR"), Verdict::ok);
  EXPECT_EQ(verdict_on(checks, "mean loss burst"), Verdict::not_comparable);
}

}  // namespace
}  // namespace tether
