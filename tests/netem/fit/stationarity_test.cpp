#include "netem/fit/stationarity.hpp"

#include <gmock/gmock.h>

#include <cmath>

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

struct Alarms {
  int at_5_percent = 0, at_limit = 0;
};

/// `alarms` of `logs` stationary ones, at a level: no more than chance allows (P < 10⁻⁵).
void expect_few(int alarms, int logs, double level) {
  const double expected = level * logs;
  EXPECT_LE(alarms, expected + 4.3 * std::sqrt(expected) + 2.0);
}

TEST(Stationarity, CallsBurstsOfAnyLengthStationary) {
  constexpr int kLogs = 400;
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
          test_stationarity(bits_of(gilbert_elliott(channel, seed), 30'000), channel).p_value;
      alarms.at_5_percent += p < 0.05 ? 1 : 0;
      alarms.at_limit += p < Stationarity::kFalseAlarm ? 1 : 0;
    }
    SCOPED_TRACE(channel.p);
    expect_few(alarms.at_5_percent, kLogs, 0.05);
    expect_few(alarms.at_limit, kLogs, Stationarity::kFalseAlarm);
    RecordProperty("alarms at 5 %, p = " + std::to_string(channel.p), alarms.at_5_percent);
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
      at_5_percent += fit.stationarity.p_value < 0.05 ? 1 : 0;
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
      EXPECT_LT(fit.stationarity.p_value, 1e-3) << "bursts of " << burst << ", seed " << seed;
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
    EXPECT_LT(fit.stationarity.p_value, 1e-3) << seed;
  }
}

TEST(Stationarity, OfAFewPacketsSaysNothing) {
  EXPECT_EQ(test_stationarity(bits_of(gilbert_elliott({0.1, 0.5, 1.0, 0.0}, 1), 100), {}).p_value,
            1.0);
}

}  // namespace
}  // namespace tether
