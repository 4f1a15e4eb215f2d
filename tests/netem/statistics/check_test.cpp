#include <gtest/gtest.h>

#include <boost/random/exponential_distribution.hpp>
#include <cmath>
#include <string>
#include <vector>

#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/markov.hpp"
#include "netem/statistics/channel_check.hpp"
#include "netem/statistics/channel_expectation.hpp"
#include "tests/netem/link/loss_rig.hpp"

namespace tether {
namespace {

using test::Chain;
using test::gilbert_elliott;
using test::kInterval;

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
  return compare_channel(
      expect_gilbert_elliott(configured, constant_delay(0.0), constant_delay(bad_delay_s)), r.loss,
      r.delays, &r.sojourns, options);
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
  for (int i = 0; i < 20000; ++i)
    loss.add(uniform_01(random) < 0.3, t += from_seconds(gap(random)));
  const auto expected = expect_markov(1.0, 1.0, 0.05, {"good", 0.7}, {"bad", 0.7});
  const auto checks = compare_channel(expected, loss, {}, nullptr);
  EXPECT_EQ(verdict_on(checks, "PRR"), Verdict::ok);
  EXPECT_EQ(verdict_on(checks, "mean loss burst"), Verdict::not_comparable);
}

}  // namespace
}  // namespace tether
