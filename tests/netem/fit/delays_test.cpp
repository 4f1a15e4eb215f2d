#include "netem/fit/delays.hpp"

#include <gmock/gmock.h>

#include <boost/math/distributions/normal.hpp>
#include <cmath>

#include "netem/fit/models.hpp"
#include "netem/fit/report.hpp"
#include "netem/stages/delay_law.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kPackets = 20'000;
constexpr double kConstant_s = 0.02;

struct Truth {
  const char* law;
  double mean_ms, sd_ms, shape;
};
const Truth kTruths[] = {{"normal", 0.0, 3.0, 3.0},
                         {"uniform", 0.0, 3.0, 3.0},
                         {"gamma", 8.0, 6.0, 3.0},
                         {"lognormal", 6.0, 8.0, 3.0},
                         {"pareto", 5.0, 6.0, 3.0}};

JitterSettings settings_of(const Truth& truth) {
  JitterSettings s;
  s.law = truth.law;
  s.mean_ms = truth.mean_ms;
  s.sd_ms = truth.sd_ms;
  s.shape = truth.shape;
  return s;
}

/// Delays as the relay makes them, of which a tenth does not arrive.
DelayLog delays_of(const JitterSettings& settings, double correlation, std::uint64_t seed,
                   int packets = kPackets) {
  constexpr double kLost = 0.1;
  DelaySequence sequence(DelayLaw(settings, settings.table_ms), correlation, RandomEngine(seed));
  RandomEngine random(seed + 1000);
  DelayLog log(1);
  for (int i = 0; i < packets; ++i) {
    const double delay_s = kConstant_s + to_seconds(sequence.next());
    log[0].push_back(uniform_01(random) < kLost ? NAN : delay_s);
  }
  return log;
}

/// The law that the fit would make the relay have.
DelayLaw fitted_law(const DelayFit& fit) {
  JitterSettings s;
  s.law = fit.law();
  if (s.law == "table") {
    for (const double x : fit.table_s) s.table_ms.push_back(x * 1e3);
    return DelayLaw(s, s.table_ms);
  }
  const DelayFit::Candidate& c = fit.candidates[fit.best];
  s.mean_ms = c.mean_s * 1e3;
  s.sd_ms = c.sd_s * 1e3;
  s.shape = c.shape;
  return DelayLaw(s, {});
}

double score(double p) { return boost::math::quantile(boost::math::normal(), p); }

/// Quantiles of the fitted law are as far from the true ones as those of the sample may be: 4.5
/// standard deviations, √(p(1−p)/n_eff) in probability.
void expect_quantiles(const DelayFit& fit, const DelayLaw& truth) {
  const DelayLaw law = fitted_law(fit);
  const double constant_s = fit.law() == "table" ? 0.0 : fit.candidates[fit.best].constant_s;
  for (const double p : {0.1, 0.5, 0.9, 0.99, 0.999}) {
    const double margin = 4.5 * std::sqrt(p * (1.0 - p) / fit.effective);
    const double value_s = constant_s + law.at_score(score(p));
    EXPECT_GE(value_s, kConstant_s + truth.at_score(score(p - margin))) << fit.law() << " at " << p;
    EXPECT_LE(value_s, kConstant_s + truth.at_score(score(std::min(p + margin, 1.0 - 1e-6))))
        << fit.law() << " at " << p;
  }
}

// A law or a quantile that is wrong is so in each log: four of them are for chance.
TEST(FitDelays, FindsTheLawOfTheRelayAndItsQuantiles) {
  for (const Truth& truth : kTruths) {
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      const DelayFit fit = fit_delays(delays_of(settings_of(truth), 0.0, seed));
      EXPECT_EQ(fit.law(), truth.law) << seed;
      EXPECT_EQ(fit.correlation, 0.0) << truth.law << ", " << seed;
      expect_quantiles(fit, DelayLaw(settings_of(truth), {}));
    }
  }
}

TEST(FitDelays, FindsTheLawAndTheCorrelationOfCorrelatedDelays) {
  for (const double correlation : {0.6, 0.9}) {
    int covers = 0;
    for (const Truth& truth : kTruths) {
      for (std::uint64_t seed = 1; seed <= 4; ++seed) {
        const DelayFit fit = fit_delays(delays_of(settings_of(truth), correlation, seed));
        covers += std::abs(fit.correlation - correlation) <= 1.96 * fit.correlation_error ? 1 : 0;
        EXPECT_NEAR(fit.correlation, correlation, 4.5 * fit.correlation_error) << truth.law;
        EXPECT_FALSE(fit.lasts_longer()) << truth.law << ", " << seed;
        expect_quantiles(fit, DelayLaw(settings_of(truth), {}));
      }
    }
    EXPECT_GE(covers, 15) << "of 20 95 % intervals: P[fewer] = 3e-4";
  }
}

TEST(FitDelays, ParametersAreWithinTheirIntervals) {
  const Truth truth{"gamma", 8.0, 6.0, 3.0};
  const double values[] = {20.0, 8.0, 6.0};
  int covers[3] = {};
  constexpr int kLogs = 40;  // logs of half the length: an interval covers in logs of any
  for (std::uint64_t seed = 1; seed <= kLogs; ++seed) {
    const DelayFit fit = fit_delays(delays_of(settings_of(truth), 0.0, seed, kPackets / 2));
    ASSERT_EQ(fit.law(), "gamma");
    const auto& parameters = fit.candidates[fit.best].parameters;
    ASSERT_EQ(parameters.size(), 3U);
    for (std::size_t i = 0; i < 3; ++i) {
      covers[i] += parameters[i].low <= values[i] && values[i] <= parameters[i].high ? 1 : 0;
      EXPECT_LT(parameters[i].standard_error, 0.2) << parameters[i].name;
    }
  }
  for (const int count : covers) EXPECT_GE(count, 32) << "P[fewer of 40] = 2e-4";
}

TEST(FitDelays, AHeavyTailIsNoLightOne) {
  const DelayFit fit = fit_delays(delays_of(settings_of({"pareto", 5.0, 6.0, 2.5}), 0.0, 1));
  const DelayFit::Candidate& c = fit.candidates[fit.best];
  EXPECT_EQ(c.law, "pareto");
  EXPECT_NEAR(c.shape, 2.5, 4.5 * c.parameters.back().standard_error);
  for (const DelayFit::Candidate& other : fit.candidates) {
    if (other.law != "pareto") {
      EXPECT_LT(other.p_value, DelayFit::kFalseAlarm) << other.law;
    }
  }
}

TEST(FitDelays, WhatNoLawHasBecomesATable) {
  JitterSettings two_humps;
  two_humps.law = "table";
  two_humps.table_ms = {0.0, 1.0, 1.2, 1.4, 9.0, 9.2, 9.4, 12.0};
  const DelayFit fit = fit_delays(delays_of(two_humps, 0.3, 1));
  EXPECT_EQ(fit.law(), "table");
  ASSERT_EQ(fit.table_s.size(), 101U);
  expect_quantiles(fit, DelayLaw(two_humps, two_humps.table_ms));
}

TEST(FitDelays, SaysWhatStaysCorrelatedForLonger) {
  // Half of it slow, half of it new each time: 0.5 at lag 1, and nearly as much at 10.
  RandomEngine random(1);
  DelayLog log(1);
  double slow = 0.0;
  for (int i = 0; i < kPackets; ++i) {
    slow = 0.99 * slow + std::sqrt(1.0 - 0.99 * 0.99) * draw_normal_score(random);
    log[0].push_back(0.05 + 0.003 * (slow + draw_normal_score(random)));
  }
  EXPECT_TRUE(fit_delays(log).lasts_longer());
}

TEST(FitDelays, OfFewOrEqualDelaysSaysTheirMean) {
  EXPECT_EQ(fit_delays({std::vector<double>(5000, 0.01)}).law(), "none");
  EXPECT_NEAR(fit_delays({std::vector<double>(5000, 0.01)}).mean_s, 0.01, 1e-12);
  EXPECT_EQ(fit_delays({{0.01, NAN, 0.02}}).law(), "none");
  EXPECT_TRUE(std::isnan(fit_delays({{NAN}}).mean_s));
}

std::vector<LoggedPacket> packets_of(const DelayLog& delays) {
  std::vector<LoggedPacket> packets;
  for (const double delay_s : delays[0]) {
    packets.push_back({0.01 * static_cast<double>(packets.size()), std::isnan(delay_s), delay_s});
  }
  return packets;
}

TEST(FitReport, HasTheDelaysAsTheRelayReadsThem) {
  const auto delays = delays_of(settings_of({"lognormal", 6.0, 8.0, 3.0}), 0.6, 1);
  const ChannelFit fit = fit_channel(fates_from_packets(packets_of(delays)), RandomEngine(1));
  const std::string toml = fit_to_toml(fit, "downlink", "my.csv");
  for (const char* key : {"delay_ms = ", "jitter.law = \"lognormal\"\n",
                          "jitter.mean_ms = ", "jitter.sd_ms = ", "jitter.correlation = "}) {
    EXPECT_THAT(toml, HasSubstr(key));
  }
  EXPECT_THAT(toml, Not(HasSubstr("jitter.shape")));
  EXPECT_THAT(describe_fit(fit), HasSubstr("* lognormal: BIC "));
}

}  // namespace
}  // namespace tether
