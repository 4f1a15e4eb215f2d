#include "netem/fit/stationarity.hpp"

#include <gmock/gmock.h>

#include <boost/random/normal_distribution.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "netem/fit/models.hpp"
#include "netem/fit/report.hpp"
#include "tests/netem/link/loss_rig.hpp"

namespace tether {
namespace {

using test::Chain;
using test::gilbert_elliott;
using ::testing::HasSubstr;

FateBits bits_of(Chain chain, int packets) {
  FateBits bits(1);
  for (int i = 0; i < packets; ++i) bits[0].push_back(chain.next_is_lost() ? 1 : 0);
  return bits;
}

FateLog log_of(const FateBits& bits) {
  std::vector<LoggedPacket> packets;
  for (const std::uint8_t lost : bits[0]) {
    packets.push_back({0.05 * static_cast<double>(packets.size()), lost == 1});
  }
  return fates_from_packets(std::move(packets));
}

/// Loss bursts of `burst` packets on average (1: independent losses); P[lost] by `loss` of the
/// share of the log that is over.
template <class Loss>
FateBits drifting(double burst, int packets, std::uint64_t seed, Loss loss) {
  RandomEngine random(seed);
  FateBits bits(1);
  bool bad = false;
  for (int i = 0; i < packets; ++i) {
    const double share = loss(static_cast<double>(i) / packets);
    if (burst <= 1.0) {
      bad = uniform_01(random) < share;
    } else {
      const double p = share / (1.0 - share) / burst;
      bad = uniform_01(random) < (bad ? 1.0 - 1.0 / burst : p);
    }
    bits[0].push_back(bad ? 1 : 0);
  }
  return bits;
}

/// TETHER_POWER_LOGS: how many logs each point of a power curve has.
int power_logs(int otherwise) {
  const char* const many = std::getenv("TETHER_POWER_LOGS");
  return many != nullptr ? std::atoi(many) : otherwise;
}

struct Alarms {
  int at_5_percent = 0, at_limit = 0;
};

/// `alarms` of `logs` stationary ones, at a level: no more than chance allows (P < 10⁻⁵).
void expect_few(int alarms, int logs, double level) {
  const double expected = level * logs;
  EXPECT_LE(alarms, expected + 4.3 * std::sqrt(expected) + 2.0);
}

TEST(Stationarity, CallsBurstsOfAnyLengthStationary) {
  constexpr int kLogs = 200;
  const GilbertElliott channels[] = {
      {0.0, 1.0, 1.0, 0.1},       // independent
      {0.02, 0.25, 1.0, 0.0},     // bursts of 4
      {0.01, 0.08, 0.7, 0.02},    // residual loss
      {0.002, 0.02, 0.9, 0.01},   // fades of 50
      {0.001, 0.002, 1.0, 0.05},  // 20 fades of 500 in a log
      {0.0005, 0.05, 1.0, 0.0},   // 15 bursts in a log
  };
  for (const GilbertElliott& channel : channels) {
    Alarms alarms;
    for (std::uint64_t seed = 1; seed <= kLogs; ++seed) {
      const double p =
          test_stationarity(bits_of(gilbert_elliott(channel, seed), 30'000), channel).p_value();
      alarms.at_5_percent += p < 0.05 ? 1 : 0;
      alarms.at_limit += p < Stationarity::kFalseAlarm ? 1 : 0;
    }
    SCOPED_TRACE(channel.p);
    expect_few(alarms.at_5_percent, kLogs, 0.05);
    expect_few(alarms.at_limit, kLogs, Stationarity::kFalseAlarm);
    std::printf("p = %g, r = %g: %d of %d alarms at 5 %%\n", channel.p, channel.r,
                alarms.at_5_percent, kLogs);
  }
}

TEST(Stationarity, AFittedModelRaisesNoMoreAlarmsThanTheTrueOne) {
  constexpr int kLogs = 60;  // half of them of each channel
  int at_5_percent = 0, at_limit = 0;
  for (const GilbertElliott& channel :
       {GilbertElliott{0.02, 0.25, 1.0, 0.0}, GilbertElliott{0.005, 0.04, 0.8, 0.02}}) {
    for (std::uint64_t seed = 1; seed <= kLogs / 2; ++seed) {
      const ChannelFit fit =
          fit_channel(log_of(bits_of(gilbert_elliott(channel, seed), 10'000)), RandomEngine(seed));
      at_5_percent += fit.stationarity.p_value() < 0.05 ? 1 : 0;
      at_limit += fit.stationarity.holds() ? 0 : 1;
    }
  }
  expect_few(at_5_percent, kLogs, 0.05);
  expect_few(at_limit, kLogs, Stationarity::kFalseAlarm);
}

TEST(Stationarity, LossThatDriftsFrom2To40PercentIsNamed) {
  for (const double burst : {1.0, 4.0}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const auto bits =
          drifting(burst, 10'000, seed, [](double share) { return 0.02 + 0.38 * share; });
      const ChannelFit fit = fit_channel(log_of(bits), RandomEngine(seed));
      EXPECT_LT(fit.stationarity.p_value(), 1e-3) << "bursts of " << burst << ", seed " << seed;
      EXPECT_FALSE(fit.fits());
      EXPECT_THAT(fit_verdict(fit), HasSubstr("the loss changes over this log"));
      EXPECT_NEAR(fit.stationarity.loss[0], 0.0675, 0.04);
      EXPECT_NEAR(fit.stationarity.loss[3], 0.3525, 0.08);
    }
  }
}

TEST(Stationarity, AStepAndABulgeAreNamedToo) {
  const auto step = [](double share) { return share < 0.6 ? 0.05 : 0.25; };
  const auto bulge = [](double share) {
    return 0.05 + 0.3 * std::exp(-50.0 * std::pow(share - 0.5, 2));
  };
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    EXPECT_FALSE(fit_channel(log_of(drifting(3.0, 10'000, seed, step)), RandomEngine(seed)).fits());
    const ChannelFit fit =
        fit_channel(log_of(drifting(3.0, 10'000, seed, bulge)), RandomEngine(seed));
    EXPECT_LT(fit.stationarity.p_value(), 1e-3) << seed;
  }
}

/// Shares of logs, whose drift is found beyond doubt, of 10 000 packets with bursts of `burst`.
template <class Loss>
double power(double burst, int logs, Loss loss, bool in_period = false) {
  int found = 0;
  for (int seed = 1; seed <= logs; ++seed) {
    const ChannelFit fit = fit_channel(
        log_of(drifting(burst, 10'000, static_cast<std::uint64_t>(seed), loss)), RandomEngine(1));
    const bool changes = !fit.stationarity.beyond_doubt();
    found += changes && (!in_period || fit.stationarity.strongest().period_packets > 0.0) ? 1 : 0;
  }
  return static_cast<double>(found) / logs;
}

/// docs/howto/fit-a-recording.md has the curve of 100 logs each, at 4, 6 and 10 %.
TEST(StationarityPower, RisesWithTheDriftAndFindsOneFrom2To10PercentInNineOfTenLogs) {
  const int logs = power_logs(30);
  for (const double burst : {1.0, 4.0}) {
    double before = 0.0;
    for (const double to : {0.04, 0.06, 0.10}) {
      const double found =
          power(burst, logs, [to](double share) { return 0.02 + (to - 0.02) * share; });
      std::printf("bursts of %.0f, 2 to %.0f %%: %.2f\n", burst, 100.0 * to, found);
      EXPECT_GE(found, before - 0.1);
      before = found;
    }
    EXPECT_GE(before, 0.9) << "bursts of " << burst;
  }
}

TEST(StationarityPower, FindsLossThatComesAndGoesAndItsPeriod) {
  const auto wave = [](double share) {
    return 0.1 + 0.08 * std::sin(2.0 * std::acos(-1.0) * 25.0 * share);
  };
  for (const double burst : {1.0, 4.0}) {
    const double found = power(burst, power_logs(15), wave, true);
    std::printf("bursts of %.0f, 10 +- 8 %%, 25 periods: %.2f\n", burst, found);
    EXPECT_GE(found, 0.9) << "bursts of " << burst;
  }
}

/// Delays of a first-order process, whose level, spread or correlation changes along the log.
std::vector<double> scores_of(std::uint64_t seed, double level, double spread, double correlation) {
  RandomEngine random(seed);
  boost::random::normal_distribution<double> normal;
  std::vector<double> delays;
  double x = 0.0;
  constexpr int kPackets = 10'000;
  for (int i = 0; i < kPackets; ++i) {
    const double share = static_cast<double>(i) / kPackets;
    const double c = 0.3 + correlation * share;
    x = c * x + std::sqrt(1.0 - c * c) * normal(random);
    delays.push_back(level * share + (1.0 + spread * share) * x);
  }
  return delay_scores({delays});
}

/// At 5 %, no more than chance allows with P < 10⁻⁵ where nothing changes.
TEST(StationarityPower, FindsDelaysWhoseLevelSpreadOrCorrelationChanges) {
  const int logs = power_logs(60);
  const auto found = [&](double level, double spread, double correlation) {
    int changes = 0;
    for (std::uint64_t seed = 1; seed <= static_cast<std::uint64_t>(logs); ++seed) {
      FateBits bits = bits_of(gilbert_elliott({0.0, 1.0, 1.0, 0.05}, seed), 10'000);
      const Stationarity s = test_stationarity(bits, {0.0, 1.0, 1.0, 0.05},
                                               scores_of(seed, level, spread, correlation));
      changes += s.beyond_doubt() ? 0 : 1;
    }
    std::printf("level %+.1f, spread %+.1f, correlation %+.1f: %d of %d\n", level, spread,
                correlation, changes, logs);
    return changes;
  };
  expect_few(found(0.0, 0.0, 0.0), logs, 0.05);
  EXPECT_GE(found(0.3, 0.0, 0.0), 0.9 * logs);
  EXPECT_GE(found(0.0, 0.3, 0.0), 0.9 * logs);
  EXPECT_GE(found(0.0, 0.0, 0.4), 0.9 * logs);
}

TEST(Stationarity, DelaysThatChangeAreNamedAndLeaveTheLossesTheirModel) {
  FateLog log = log_of(bits_of(gilbert_elliott({0.02, 0.25, 1.0, 0.0}, 1), 10'000));
  RandomEngine random(1);
  double share = 0.0;
  for (LoggedPacket& packet : log.segments[0]) {
    share += 1e-4;
    if (!packet.lost) packet.delay_s = 0.02 + 0.01 * share + 0.01 * uniform_01(random);
  }
  const ChannelFit fit = fit_channel(log, RandomEngine(1));
  EXPECT_TRUE(fit.fits());
  EXPECT_FALSE(fit.stationarity.beyond_doubt());
  EXPECT_THAT(fit_verdict(fit), HasSubstr("but the delays' level changes over this log"));
}

// Analytically: two squares are exponential, P[Z1² + Z2² > x (Z3² + Z4²)] = 1/(1 + x).
TEST(PositiveProbability, IsThatOfTheFLaw) {
  for (const double x : {0.5, 1.0, 9.0, 999.0}) {
    EXPECT_NEAR(positive_probability({1.0, 1.0, -x, -x}), 1.0 / (1.0 + x), 1e-7) << x;
  }
}

TEST(Stationarity, OfAFewPacketsSaysNothing) {
  EXPECT_EQ(test_stationarity(bits_of(gilbert_elliott({0.1, 0.5, 1.0, 0.0}, 1), 100), {}).p_value(),
            1.0);
}

}  // namespace
}  // namespace tether
