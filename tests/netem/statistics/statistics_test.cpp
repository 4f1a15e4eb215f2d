#include <gtest/gtest.h>

#include <boost/random/exponential_distribution.hpp>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/models/four_state.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/markov.hpp"
#include "netem/statistics/channel_check.hpp"
#include "netem/statistics/channel_expectation.hpp"
#include "netem/statistics/loss_record.hpp"
#include "tests/netem/link/loss_rig.hpp"

namespace tether {
namespace {

using test::Chain;
using test::covers;
using test::expect_misses;
using test::gilbert_elliott;
using test::kIndependent;
using test::kInterval;
using test::record_of;

// ---------------------------------------------------------------------------- intervals

TEST(ProportionInterval, IsClopperAndPearsons) {
  // Solves P[X >= 10] = 0.025 and P[X <= 10] = 0.025 for 100 trials.
  const Estimate e = proportion_interval(10, 100, 0.95);
  EXPECT_NEAR(e.low, 0.0490047, 1e-6);
  EXPECT_NEAR(e.high, 0.1762226, 1e-6);
}

TEST(ProportionInterval, WithoutSuccessesIsBoundedFromAbove) {
  const Estimate e = proportion_interval(0, 100, 0.95);
  EXPECT_EQ(e.low, 0.0);
  EXPECT_NEAR(e.high, 1.0 - std::pow(0.025, 1.0 / 100), 1e-12);  // (1 − p)^100 = 0.025
}

TEST(MeanTimeInterval, WithoutEventsIsBoundedFromBelow) {
  const Estimate e = mean_time_interval(0, 30.0, 0.95);
  EXPECT_TRUE(std::isnan(e.value));
  EXPECT_NEAR(e.low, 30.0 / -std::log(0.025), 1e-9);  // exp(−30/T) = 0.025
  EXPECT_TRUE(std::isinf(e.high));
}

// ---------------------------------------------------------------------------- loss record

TEST(LossRecord, CountsBurstsByLength) {
  const LossRecord r = record_of({0, 1, 0, 1, 1, 0, 0, 1, 1, 0, 1, 1, 1});
  EXPECT_EQ(r.packets(), 13);
  EXPECT_EQ(r.lost(), 8);
  EXPECT_EQ(r.bursts(), 4);
  EXPECT_EQ(r.longest_burst(), 3);
  EXPECT_EQ(r.burst_histogram(), (std::vector<std::int64_t>{0, 1, 2}));  // the last is under way
  EXPECT_DOUBLE_EQ(r.mean_burst(0.95, kIndependent).value, 2.0);
  EXPECT_DOUBLE_EQ(r.prr(0.95, kIndependent).value, 5.0 / 13.0);
}

TEST(LossRecord, CorrelationOfAlternatingFatesIsMinusOne) {
  std::vector<int> fates;
  for (int i = 0; i < 10000; ++i) fates.push_back(i % 2);
  EXPECT_NEAR(record_of(fates).lag1_correlation(0.95, kIndependent).value, -1.0, 1e-3);
}

TEST(LossRecord, SaysNothingAboutBurstsIfNothingIsLost) {
  const LossRecord r = record_of(std::vector<int>(100, 0));
  EXPECT_TRUE(std::isnan(r.mean_burst(0.95, kIndependent).value));
  EXPECT_TRUE(std::isnan(r.lag1_correlation(0.95, kIndependent).value));
  EXPECT_EQ(r.prr(0.95, kIndependent).value, 1.0);
  EXPECT_LT(r.prr(0.95, kIndependent).low, 1.0);
}

TEST(LossRecord, KnowsWhetherPacketsComeRegularly) {
  LossRecord regular, irregular;
  boost::random::exponential_distribution<double> gap(20.0);
  RandomEngine random(1);
  Instant t = kStart;
  for (int i = 0; i < 1000; ++i) {
    regular.add(false, kStart + i * kInterval);
    irregular.add(false, t += from_seconds(gap(random)));
  }
  EXPECT_NEAR(regular.interval_variation(), 0.0, 1e-9);
  EXPECT_DOUBLE_EQ(regular.mean_interval_s(), 0.05);
  // Exponential: sd = mean; the ratio's own sd is 1/√n.
  EXPECT_NEAR(irregular.interval_variation(), 1.0, 5.0 / std::sqrt(1000.0));
}

// ---------------------------------------------------------------------------- expectation

TEST(ChannelExpectation, OfIndependentLossIsBernoullis) {
  const auto e = ChannelExpectation::independent(0.7);
  EXPECT_DOUBLE_EQ(e.prr(), 0.7);
  EXPECT_DOUBLE_EQ(e.mean_burst(), 1.0 / 0.7);
  EXPECT_NEAR(e.lag1_correlation(), 0.0, 1e-15);
  EXPECT_NEAR(e.spread().vif, 1.0, 1e-12);
}

TEST(ChannelExpectation, OfTheSimpleGilbertModelIsTheClosedForm) {
  const double p = 0.03, r = 0.2;
  const auto e = expect_gilbert_elliott({p, r, 1.0, 0.0});
  EXPECT_NEAR(1.0 - e.prr(), p / (p + r), 1e-14);
  EXPECT_NEAR(e.mean_burst(), 1.0 / r, 1e-12);
  EXPECT_NEAR(e.lag1_correlation(), 1.0 - p - r, 1e-12);
  EXPECT_NEAR(e.spread().vif, (2.0 - p - r) / (p + r), 1e-10);
  // Bursts are geometric and independent: the continuation's share has binomial variance.
  EXPECT_NEAR(e.spread().burst_vif, 1.0, 1e-9);
  EXPECT_NEAR(e.mean_sojourn(0), 1.0 / p, 1e-12);
  EXPECT_NEAR(e.mean_sojourn(1), 1.0 / r, 1e-12);
}

TEST(ChannelExpectation, OfGilbertElliottIsTheClosedForm) {
  const double p = 0.02, r = 0.1, bad = 0.6, good = 0.01;
  const auto e = expect_gilbert_elliott({p, r, bad, good});
  const double pi_b = p / (p + r), pi_g = r / (p + r), rho = 1.0 - p - r;
  const double loss = pi_g * good + pi_b * bad;
  const double c = pi_g * pi_b * (bad - good) * (bad - good) / (loss * (1.0 - loss));
  EXPECT_NEAR(1.0 - e.prr(), loss, 1e-14);
  EXPECT_NEAR(e.lag1_correlation(), c * rho, 1e-12);
  EXPECT_NEAR(e.spread().vif, 1.0 + 2.0 * c * rho / (1.0 - rho), 1e-10);
}

TEST(ChannelExpectation, OfTheFourStateModelIsSalsanosClosedForm) {
  // Losses alone (4) and in bursts (3) by balance: π1(p13 + p14) = π3·p31 + π4, π4 = π1·p14,
  // π1·p13 = π3·p31, π2·p23 = π3·p32.
  const FourState m{0.02, 0.3, 0.2, 0.5, 0.01};
  const auto e = expect_four_state(m);
  const double pi1 = 1.0 / (1.0 + m.p14 + m.p13 / m.p31 * (1.0 + m.p32 / m.p23));
  const double pi3 = pi1 * m.p13 / m.p31, pi4 = pi1 * m.p14;
  EXPECT_NEAR(1.0 - e.prr(), pi3 + pi4, 1e-14);
  // Bursts begin 1→3, 1→4 and 2→3.
  const double begins = pi1 * (m.p13 + m.p14) + pi3 * m.p32 / m.p23 * m.p23;
  EXPECT_NEAR(e.mean_burst(), (pi3 + pi4) / begins, 1e-12);
}

TEST(ChannelExpectation, OfAMarkovProcessInTimeIsThatOfItsSampledChain) {
  const Matrix rates{{0.0, 1.0 / 2.4}, {1.0 / 0.8, 0.0}};
  const ExpectedState good{"good", 0.99, constant_delay(0.01)},
      bad{"bad", 0.3, constant_delay(0.2)};
  const auto closed = expect_markov(2.4, 0.8, 0.05, good, bad);
  const auto numeric = ChannelExpectation::process(rates, 0.05, {good, bad});
  EXPECT_NEAR(closed.prr(), 0.75 * 0.99 + 0.25 * 0.3, 1e-12);
  EXPECT_NEAR(closed.lag1_correlation(), numeric.lag1_correlation(), 1e-12);
  EXPECT_NEAR(closed.spread().vif, numeric.spread().vif, 1e-8);
  EXPECT_NEAR(closed.mean_burst(), numeric.mean_burst(), 1e-10);
  EXPECT_DOUBLE_EQ(closed.mean_sojourn(1), 0.8);
  EXPECT_DOUBLE_EQ(numeric.mean_sojourn(1), 0.8);
}

TEST(ChannelExpectation, DelayQuantilesAreThoseOfTheReceivedPackets) {
  // Received: 3/4·1.0 without delay, 1/4·0.5 with 500 ms: 6/7 of all are at once.
  const auto e = expect_markov(24.0, 8.0, 0.05, {"good", 1.0, constant_delay(0.0)},
                               {"bad", 0.5, constant_delay(0.5)});
  EXPECT_EQ(e.delay_quantile(0.5), 0.0);
  EXPECT_EQ(e.delay_quantile(0.857), 0.0);
  EXPECT_NEAR(e.delay_quantile(0.858), 0.5, 1e-12);
  const auto exponential =
      ChannelExpectation::independent(0.5, [](double t_s) { return -std::expm1(-t_s / 0.02); });
  EXPECT_NEAR(exponential.delay_quantile(0.9), -0.02 * std::log(0.1), 1e-12);
  EXPECT_NEAR(exponential.delay_vif(0.9), 1.0, 1e-12);
}

TEST(ChannelExpectation, RefusesChainsWithoutOneStationaryDistribution) {
  const Matrix parts{{1.0, 0.0}, {0.0, 1.0}}, short_row{{0.9, 0.0}, {0.9, 0.0}};
  const std::vector<ExpectedState> states(2);
  EXPECT_THROW(ChannelExpectation::chain(parts, states), UsageError);
  EXPECT_THROW(ChannelExpectation::chain(short_row, states), UsageError);
}

// ---------------------------------------------------------------------------- sojourns

TEST(SojournStatistics, UseTheSojournsAtBothEnds) {
  SojournStatistics s(2);
  s.enter(0, 0.0);
  s.enter(0, 1.0);  // no change
  s.enter(1, 4.0);
  s.enter(0, 6.0);
  s.advance(10.0);
  EXPECT_EQ(s.departures(0), 1);
  EXPECT_EQ(s.departures(1), 1);
  EXPECT_DOUBLE_EQ(s.mean(0, 0.95).value, 8.0);
  EXPECT_DOUBLE_EQ(s.mean(1, 0.95).value, 2.0);
}

TEST(SojournStatistics, CoverTheTruthAsOftenAsTheySay) {
  int misses = 0;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    RandomEngine random(seed);
    SojournStatistics s(2);
    double t = 0.0;
    for (std::size_t state = 0; t < 300.0; state = 1 - state) {
      s.enter(state, t);
      t += boost::random::exponential_distribution<double>(state == 0 ? 0.5 : 1.0)(random);
    }
    s.advance(t);
    misses += covers(s.mean(0, 0.95), 2.0) ? 0 : 1;
  }
  expect_misses(misses, "Markov process", "sojourn");
}

// ---------------------------------------------------------------------------- delays

TEST(DelayStatistics, ReportAConstantExactly) {
  DelayStatistics d;
  for (int i = 0; i < 3000; ++i) d.add(std::chrono::microseconds{123457});
  const Estimate e = d.quantile(0.9, 0.999, 1.0);
  EXPECT_DOUBLE_EQ(e.value, 0.123457);
  EXPECT_DOUBLE_EQ(e.low, 0.123457);
  EXPECT_DOUBLE_EQ(e.high, 0.123457);
  EXPECT_EQ(d.estimated_vif(0), 1.0);
}

TEST(DelayStatistics, HaveNoUpperBoundWhereEvenTheLargestDelayIsNone) {
  DelayStatistics d;
  for (int i = 0; i < 100; ++i) d.add(std::chrono::milliseconds{i});
  EXPECT_TRUE(std::isinf(d.quantile(0.99, 0.95, 1.0).high));  // 0.99^100 = 0.37
  EXPECT_TRUE(std::isfinite(d.quantile(0.5, 0.95, 1.0).high));
  EXPECT_EQ(DelayStatistics().quantile(0.5, 0.95, 1.0).effective_samples, 0.0);
}

TEST(DelayStatistics, CoverTheTruthUnderCorrelationAsOftenAsTheySay) {
  // 10 ms in the good state, exponential with mean 50 ms more in the bad one.
  const DelayCdf bad_delay = [](double t_s) {
    return t_s <= 0.01 ? 0.0 : -std::expm1((0.01 - t_s) / 0.05);
  };
  const GilbertElliott m{0.02, 0.05, 0.4, 0.0};
  const auto e = expect_gilbert_elliott(m, constant_delay(0.01), bad_delay);
  boost::random::exponential_distribution<double> extra(1.0 / 0.05);
  int known = 0, estimated = 0, naive = 0;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    Chain chain = gilbert_elliott(m, seed);
    RandomEngine random(seed + 10000);
    DelayStatistics d;
    for (int i = 0; i < 10000; ++i) {
      const bool bad = chain.state == 1;
      if (!chain.next_is_lost()) d.add(from_seconds(0.01 + (bad ? extra(random) : 0.0)));
    }
    const double truth = e.delay_quantile(0.9);
    known += covers(d.quantile(0.9, 0.95, e.delay_vif(0.9)), truth) ? 0 : 1;
    estimated += covers(d.quantile(0.9, 0.95, d.estimated_vif(1)), truth) ? 0 : 1;
    naive += covers(d.quantile(0.9, 0.95, 1.0), truth) ? 0 : 1;
  }
  expect_misses(known, "Gilbert-Elliott", "delay p90");
  expect_misses(estimated, "Gilbert-Elliott, estimated", "delay p90", 104);
  EXPECT_GT(naive, 200);
}

}  // namespace
}  // namespace tether
