#include <gmock/gmock.h>

#include <cmath>
#include <memory>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/markov_chain.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/stages/kinds.hpp"
#include "tests/netem/link/loss_statistics.hpp"
#include "tests/support/virtual_world.hpp"

// Chains of N states. Tolerances: 5 standard deviations.

namespace tether {
namespace {

using test::at_s;
using ::testing::DoubleNear;
using ::testing::ElementsAre;

constexpr double kChainSigmas = 5.0;

const Matrix kRates{{0.0, 2.0, 1.0}, {4.0, 0.0, 0.5}, {3.0, 0.0, 0.0}};
const Matrix kSteps{{0.9, 0.1, 0.0}, {0.2, 0.5, 0.3}, {0.4, 0.0, 0.6}};

ChainClock rates(std::uint64_t seed) {
  return ChainClock::from_rates(kRates, "key", random_stream(seed, "state"));
}

// -------------------------------------------------------------------- stationary distribution

TEST(StationaryDistribution, BalancesWhatEntersAndWhatLeaves) {
  const auto share = *stationary_distribution(kRates);
  for (std::size_t j = 0; j < 3; ++j) {
    double in = 0.0, out = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      if (i == j) continue;
      in += share[i] * kRates[i][j];
      out += share[j] * kRates[j][i];
    }
    EXPECT_NEAR(in, out, 1e-15);
  }
  EXPECT_NEAR(share[0] + share[1] + share[2], 1.0, 1e-15);
}

TEST(StationaryDistribution, KeepsTheDigitsOfRareStates) {
  const auto share = *stationary_distribution({{1.0, 1e-14}, {0.5, 0.5}});
  EXPECT_NEAR(share[1] / 2e-14, 1.0, 1e-12);
}

TEST(StationaryDistribution, GivesNothingToStatesThatAreLeftForGood) {
  const auto share = *stationary_distribution({{0.0, 1.0, 1.0}, {0.0, 0.0, 1.0}, {0.0, 3.0, 0.0}});
  EXPECT_THAT(share, ElementsAre(0.0, DoubleNear(0.75, 1e-15), DoubleNear(0.25, 1e-15)));
}

TEST(StationaryDistribution, IsAllInAStateThatIsNeverLeft) {
  EXPECT_THAT(*stationary_distribution({{0.5, 0.5}, {0.0, 1.0}}), ElementsAre(0.0, 1.0));
}

TEST(StationaryDistribution, DoesNotExistWhereTheBeginningDecides) {
  EXPECT_FALSE(stationary_distribution({{1.0, 0.0}, {0.0, 1.0}}));
  EXPECT_THROW(ChainClock::from_rates({{0.0, 0.0}, {0.0, 0.0}}, "channel.uplink.chain", {}),
               UsageError);
}

// -------------------------------------------------------------------- chains in time

TEST(ChainClock, SojournsAreExponentialAndJumpsFollowTheRates) {
  ChainClock clock = rates(1);
  double sum_s[3] = {}, count[3] = {}, longer[3] = {}, jumps[3][3] = {};
  const double mean_s[3] = {1.0 / 3.0, 1.0 / 4.5, 1.0 / 3.0};
  Instant entered = clock.next_transition();  // the first sojourn's beginning is not known
  clock.advance(entered);
  for (int i = 0; i < 200'000; ++i) {
    const auto state = static_cast<std::size_t>(clock.state());
    const Instant change = clock.next_transition();
    const double sojourn_s = to_seconds(change - entered);
    sum_s[state] += sojourn_s;
    count[state] += 1.0;
    longer[state] += sojourn_s > mean_s[state] ? 1.0 : 0.0;
    clock.advance(change);
    jumps[state][static_cast<std::size_t>(clock.state())] += 1.0;
    entered = change;
  }
  for (std::size_t s = 0; s < 3; ++s) {
    // Exponential: standard deviation = mean; P[X > mean] = 1/e.
    EXPECT_NEAR(sum_s[s] / count[s], mean_s[s], kChainSigmas * mean_s[s] / std::sqrt(count[s]));
    const double p = std::exp(-1.0);
    EXPECT_NEAR(longer[s] / count[s], p, kChainSigmas * std::sqrt(p * (1.0 - p) / count[s]));
    EXPECT_EQ(jumps[s][s], 0.0);
  }
  const double from_0 = jumps[0][1] + jumps[0][2];
  EXPECT_NEAR(jumps[0][1] / from_0, 2.0 / 3.0, kChainSigmas * std::sqrt(2.0 / 9.0 / from_0));
  EXPECT_EQ(jumps[2][1], 0.0);
}

TEST(ChainClock, BeginsInTheStationaryDistributionAndKeepsIt) {
  constexpr int kSeeds = 20'000;
  const auto share = *stationary_distribution(kRates);
  for (const double t : {0.0, 0.3, 5.0}) {
    double count[3] = {};
    for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
      ChainClock clock = rates(seed);
      clock.advance(at_s(t));
      count[clock.state()] += 1.0;
    }
    for (std::size_t s = 0; s < 3; ++s) {
      EXPECT_NEAR(count[s] / kSeeds, share[s],
                  kChainSigmas * std::sqrt(share[s] * (1.0 - share[s]) / kSeeds));
    }
  }
}

TEST(ChainClock, DoesNotDependOnHowOftenItIsAsked) {
  ChainClock often = rates(3), once = rates(3);
  for (double t = 0.0; t < 100.0; t += 0.01) often.advance(at_s(t));
  once.advance(at_s(99.99));
  EXPECT_EQ(often.state(), once.state());
  EXPECT_EQ(often.next_transition(), once.next_transition());
  once.advance(at_s(1.0));
  EXPECT_EQ(often.next_transition(), once.next_transition());
}

TEST(ChainClock, StepsAtMultiplesOfItsStepWithGeometricSojourns) {
  constexpr double kStep_s = 0.125;
  ChainClock clock =
      ChainClock::from_probabilities(kSteps, kStep_s, "key", random_stream(1, "state"));
  double sum[3] = {}, count[3] = {}, one[3] = {};
  Instant entered = clock.next_transition();
  clock.advance(entered);
  for (int i = 0; i < 100'000; ++i) {
    const auto state = static_cast<std::size_t>(clock.state());
    const Instant change = clock.next_transition();
    const double steps = to_seconds(change - entered) / kStep_s;
    ASSERT_EQ(steps, std::round(steps));
    sum[state] += steps;
    count[state] += 1.0;
    one[state] += steps == 1.0 ? 1.0 : 0.0;
    clock.advance(change);
    entered = change;
  }
  for (std::size_t s = 0; s < 3; ++s) {
    // Geometric: mean 1/q, variance (1−q)/q², P[1] = q, with q the probability of leaving.
    const double q = 1.0 - kSteps[s][s];
    EXPECT_NEAR(sum[s] / count[s], 1.0 / q, kChainSigmas * std::sqrt((1.0 - q) / count[s]) / q);
    EXPECT_NEAR(one[s] / count[s], q, kChainSigmas * std::sqrt(q * (1.0 - q) / count[s]));
  }
}

TEST(ChainClock, StaysForeverInAStateThatIsNeverLeft) {
  ChainClock clock = ChainClock::from_rates({{0.0, 1.0}, {0.0, 0.0}}, "key", {});
  EXPECT_EQ(clock.state(), 1);
  EXPECT_EQ(clock.next_transition(), Instant::max());
}

// -------------------------------------------------------------------- chains per packet

TEST(PacketChain, LosesAndLingersAsItsMatrixSays) {
  const std::vector<double> loss{0.0, 0.4, 1.0};
  std::vector<LinkCondition> conditions;
  for (const double e : loss) conditions.push_back({1.0 - e, Duration{0}});
  const auto streams = [](std::string_view purpose) { return random_stream(1, purpose); };
  Link link(make_stages(LinkConfig{}, "", streams),
            std::make_shared<PacketChainProcess>(kSteps, conditions, "key", streams("state")));
  constexpr int kPackets = 1'000'000;
  int bursts = 0;
  bool before = false;
  for (int i = 0; i < kPackets; ++i) {
    const bool lost = link.push(kStart, {}) == Instant::max();
    bursts += lost && !before ? 1 : 0;
    before = lost;
    link.pop_ready(kStart, [](const Packet&) {});
  }
  const LossStatistics formula = *LossStatistics::of_chain(kSteps, loss);
  const auto lost = static_cast<double>(link.counters().lost);
  EXPECT_NEAR(lost / kPackets, formula.loss_ratio(),
              kChainSigmas * formula.loss_ratio_sd(kPackets));
  // The number of bursts is the count of ends; its variance is below that of as many independent
  // packets inflated as the losses are.
  const double ends = formula.loss_ratio() / formula.mean_burst();
  EXPECT_NEAR(static_cast<double>(bursts) / kPackets, ends,
              kChainSigmas * std::sqrt(ends * formula.variance_inflation() / kPackets));
}

// -------------------------------------------------------------------- from scenarios

TEST(MakeLinks, AChainHasItsStatesDelaysAndMayBeShared) {
  Scenario scenario = parse_scenario(R"(
[channel]
shared_state = true
[channel.uplink]
model = "chain"
chain = { prr = [1.0, 0.5], delay_ms = [0.0, 40.0], rates_per_s = [[0, 1], [1, 0]] }
[channel.downlink]
model = "chain"
chain = { prr = [0.9, 0.1], rates_per_s = [[0, 1], [1, 0]] }
)",
                                     "test.toml");
  LinkPair links = make_links(scenario);
  for (int i = 0; i < 1000; ++i) {
    const Instant now = at_s(0.1 * i);
    const LinkCondition up = links.uplink.process().on_packet(now);
    const LinkCondition down = links.downlink.process().on_packet(now);
    const bool bad = links.uplink.process().state() == 1;
    EXPECT_EQ(up, (LinkCondition{bad ? 0.5 : 1.0, std::chrono::milliseconds{bad ? 40 : 0}}));
    EXPECT_EQ(down, (LinkCondition{bad ? 0.1 : 0.9, Duration{0}}));
  }
}

TEST(MakeLinks, ModelsPerPacketFollowTheScenario) {
  for (const char* model : {"model = \"gilbert_elliott\"\ngilbert_elliott = { prr = 0.45, "
                            "mean_burst = 20.0 }",
                            "model = \"four_state\"\nfour_state = { p13 = 0.02, p31 = 0.15, "
                            "p32 = 0.3, p23 = 0.6, p14 = 0.01 }"}) {
    Scenario s = parse_scenario(std::string("[channel.uplink]\ndelay_ms = 7.0\n") + model, "x");
    LinkPair links = make_links(s);
    const auto formula = s.get<ChannelSettings>().uplink.model == "four_state"
                             ? LossStatistics::of(FourState{0.02, 0.15, 0.3, 0.6, 0.01})
                             : LossStatistics::of(gilbert_from_burst(0.45, 20.0));
    constexpr int kPackets = 200'000;
    for (int i = 0; i < kPackets; ++i) {
      const Instant leaves = links.uplink.push(kStart, {});
      EXPECT_TRUE(leaves == Instant::max() || leaves == kStart + std::chrono::milliseconds{7});
      links.uplink.pop_ready(leaves == Instant::max() ? kStart : leaves, [](const Packet&) {});
    }
    EXPECT_NEAR(static_cast<double>(links.uplink.counters().lost) / kPackets, formula->loss_ratio(),
                kChainSigmas * formula->loss_ratio_sd(kPackets));
  }
}

}  // namespace
}  // namespace tether
