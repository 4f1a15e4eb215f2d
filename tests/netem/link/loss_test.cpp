#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <numeric>
#include <vector>

#include "netem/models/four_state.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/markov_chain.hpp"
#include "netem/stages/kinds.hpp"
#include "tests/netem/link/loss_statistics.hpp"
#include "tests/support/virtual_world.hpp"

// Loss models against their formulas. All tolerances are 5 standard deviations of what is measured
// (error level 6e-7 for a normal distribution).

namespace tether {

void PrintTo(const GilbertElliott& m, std::ostream* out) {
  *out << m.p << " " << m.r << " " << m.one_minus_h << " " << m.one_minus_k;
}

void PrintTo(const FourState& m, std::ostream* out) {
  *out << m.p13 << " " << m.p31 << " " << m.p32 << " " << m.p23 << " " << m.p14;
}

namespace {

using test::at_s;

constexpr double kSigmas = 5.0;

LinkStreams streams(std::uint64_t seed) {
  return [seed](std::string_view purpose) { return random_stream(seed, purpose); };
}

std::shared_ptr<ChannelProcess> process(const GilbertElliott& model, std::uint64_t seed) {
  return std::make_shared<GilbertElliottProcess>(model, Duration{0}, streams(seed)("state"));
}

std::shared_ptr<ChannelProcess> process(const FourState& model, std::uint64_t seed) {
  return std::make_shared<FourStateProcess>(model, Duration{0}, streams(seed)("state"));
}

/// Which of `packets` packets a link loses, after as many as it takes to forget how it began.
std::vector<bool> losses(std::shared_ptr<ChannelProcess> process, std::uint64_t seed,
                         std::size_t packets, std::size_t warm_up) {
  Link link(make_stages(LinkConfig{}, "", streams(seed)), std::move(process));
  std::vector<bool> lost;
  for (std::size_t i = 0; i < warm_up + packets; ++i) {
    const bool is_lost = link.push(kStart, {"X", {}}) == Instant::max();
    link.pop_ready(kStart, [](const Packet&) {});
    if (i >= warm_up) lost.push_back(is_lost);
  }
  return lost;
}

double ratio(const std::vector<bool>& lost) {
  return static_cast<double>(std::count(lost.begin(), lost.end(), true)) /
         static_cast<double>(lost.size());
}

/// Share of the packets that are lost together with the one `lag` later.
double both_lost(const std::vector<bool>& lost, std::size_t lag) {
  std::size_t both = 0;
  for (std::size_t i = 0; i + lag < lost.size(); ++i) both += lost[i] && lost[i + lag] ? 1 : 0;
  return static_cast<double>(both) / static_cast<double>(lost.size() - lag);
}

/// Mean length of bursts of losses, but for what the ends of the record cut off.
double burst_length(const std::vector<bool>& lost) {
  return ratio(lost) / (ratio(lost) - both_lost(lost, 1));
}

/// Losses of independent runs.
template <class Model>
std::vector<std::vector<bool>> runs(const Model& model, std::size_t count, std::size_t packets,
                                    std::size_t warm_up) {
  std::vector<std::vector<bool>> all;
  for (std::uint64_t seed = 1; seed <= count; ++seed) {
    all.push_back(losses(process(model, seed), seed, packets, warm_up));
  }
  return all;
}

/// Mean, its standard deviation and the standard deviation of one, from independent repetitions.
struct Repeated {
  double mean = 0.0;
  double mean_sd = 0.0;
  double sd = 0.0;
};

Repeated repeat(const std::vector<std::vector<bool>>& runs,
                const std::function<double(const std::vector<bool>& lost)>& measure) {
  std::vector<double> values;
  for (const auto& lost : runs) values.push_back(measure(lost));
  const auto times = static_cast<double>(runs.size());
  Repeated r;
  r.mean = std::accumulate(values.begin(), values.end(), 0.0) / times;
  for (const double x : values) r.sd += (x - r.mean) * (x - r.mean) / (times - 1);
  r.sd = std::sqrt(r.sd);
  r.mean_sd = r.sd / std::sqrt(times);
  return r;
}

constexpr GilbertElliott kGilbertElliotts[] = {{0.05, 0.25, 1.0, 0.0},
                                               {0.02, 0.1, 0.7, 0.03},
                                               {0.9, 0.8, 0.9, 0.1},  // alternates: ρ < 0
                                               {0.3, 0.7, 0.5, 0.5}};

// -------------------------------------------------------------------- Gilbert–Elliott

struct GilbertElliottTest : ::testing::TestWithParam<GilbertElliott> {
  const GilbertElliott model = GetParam();
  const double pi_bad = model.p / (model.p + model.r);
  const double pi_good = model.r / (model.p + model.r);
  const double rho = 1.0 - model.p - model.r;
  const double loss = pi_good * model.one_minus_k + pi_bad * model.one_minus_h;
  const double spread = model.one_minus_h - model.one_minus_k;
  const double covariance_0 = pi_good * pi_bad * spread * spread;
  const double inflation = 1.0 + 2.0 * covariance_0 / (loss * (1.0 - loss)) * rho / (1.0 - rho);
  const std::size_t warm_up = 1000;
};

TEST_P(GilbertElliottTest, LosesThePredictedShare) {
  constexpr std::size_t kPackets = 1'000'000;
  const double sd = std::sqrt(loss * (1.0 - loss) * inflation / kPackets);
  EXPECT_NEAR(ratio(losses(process(model, 1), 1, kPackets, warm_up)), loss, kSigmas * sd);
}

TEST_P(GilbertElliottTest, ScattersByTheVarianceInflationFactor) {
  constexpr std::size_t kPackets = 2000;
  constexpr int kRuns = 1000;
  const Repeated r = repeat(runs(model, kRuns, kPackets, warm_up), ratio);
  const double sd = std::sqrt(loss * (1.0 - loss) * inflation / kPackets);
  // A sample's standard deviation scatters by 1/sqrt(2(n−1)) of itself.
  EXPECT_NEAR(r.sd, sd, kSigmas * sd / std::sqrt(2.0 * (kRuns - 1)));
}

TEST_P(GilbertElliottTest, HasThePredictedAutocovarianceAtLags1To5) {
  const auto all = runs(model, 100, 20'000, warm_up);
  for (std::size_t lag = 1; lag <= 5; ++lag) {
    const Repeated r =
        repeat(all, [&](const auto& lost) { return both_lost(lost, lag) - loss * loss; });
    EXPECT_NEAR(r.mean, covariance_0 * std::pow(rho, static_cast<double>(lag)), kSigmas * r.mean_sd)
        << "lag " << lag;
  }
}

TEST_P(GilbertElliottTest, LosesInBurstsOfThePredictedMeanLength) {
  const double good = model.one_minus_k, bad = model.one_minus_h;
  const double both = pi_good * good * ((1.0 - model.p) * good + model.p * bad) +
                      pi_bad * bad * ((1.0 - model.r) * bad + model.r * good);
  const Repeated r = repeat(runs(model, 100, 20'000, warm_up), burst_length);
  EXPECT_NEAR(r.mean, loss / (loss - both), kSigmas * r.mean_sd);
}

TEST_P(GilbertElliottTest, AgreesWithTheFormulasOfChains) {
  const LossStatistics s = *LossStatistics::of(model);
  EXPECT_NEAR(s.loss_ratio(), loss, 1e-12);
  EXPECT_NEAR(s.variance_inflation(), inflation, 1e-9);
  EXPECT_NEAR(s.autocovariance(3), covariance_0 * rho * rho * rho, 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Netem, GilbertElliottTest, ::testing::ValuesIn(kGilbertElliotts));

TEST(GilbertElliott, BeginsGoodAndJudgesAPacketByTheStateBeforeItsStep) {
  // Changes state with every packet: the first meets the good state, the second the bad one.
  const auto lost = losses(process(GilbertElliott{1.0, 1.0, 1.0, 0.0}, 1), 1, 6, 0);
  EXPECT_EQ(lost, (std::vector<bool>{false, true, false, true, false, true}));
}

TEST(GilbertElliott, TwoEqualStatesAreIndependentLosses) {
  EXPECT_NEAR(LossStatistics::of(GilbertElliott{0.3, 0.7, 0.5, 0.5})->variance_inflation(), 1.0,
              1e-12);
}

TEST(GilbertElliott, FollowsFromReceptionRatioAndMeanBurst) {
  for (const auto& [prr, burst] : {std::pair{0.9, 1.5}, {0.45, 20.0}, {0.25, 3.0}, {0.99, 1.0}}) {
    const GilbertElliott model = gilbert_from_burst(prr, burst);
    const LossStatistics s = *LossStatistics::of(model);
    EXPECT_NEAR(1.0 - s.loss_ratio(), prr, 1e-12);
    EXPECT_NEAR(s.mean_burst(), burst, 1e-9);
    EXPECT_LE(model.p, 1.0 + 1e-12);
  }
}

TEST(GilbertElliott, TheShortestBurstLeavesTheGoodStateAtOnce) {
  EXPECT_DOUBLE_EQ(shortest_mean_burst(0.2), 4.0);
  EXPECT_DOUBLE_EQ(gilbert_from_burst(0.2, 4.0).p, 1.0);
  EXPECT_DOUBLE_EQ(shortest_mean_burst(0.8), 1.0);
  EXPECT_DOUBLE_EQ(gilbert_from_burst(0.8, 1.0).r, 1.0);
}

TEST(GilbertElliott, BurstsOfTheSimpleModelAreGeometric) {
  const GilbertElliott model{0.05, 0.25, 1.0, 0.0};
  const auto lost = losses(process(model, 3), 3, 1'000'000, 0);
  double bursts = 0.0, of_one = 0.0;
  for (std::size_t i = 1; i + 1 < lost.size(); ++i) {
    if (lost[i - 1] || !lost[i]) continue;
    bursts += 1.0;
    of_one += lost[i + 1] ? 0.0 : 1.0;
  }
  const double lost_packets = ratio(lost) * static_cast<double>(lost.size());
  // Geometric with r: mean 1/r, variance (1−r)/r²; P[length 1] = r.
  EXPECT_NEAR(lost_packets / bursts, 4.0, kSigmas * std::sqrt(0.75 * 16.0 / bursts));
  EXPECT_NEAR(of_one / bursts, 0.25, kSigmas * std::sqrt(0.25 * 0.75 / bursts));
}

// -------------------------------------------------------------------- four states

struct FourStateTest : ::testing::TestWithParam<FourState> {
  const FourState model = GetParam();
  const LossStatistics formula = *LossStatistics::of(model);
};

TEST_P(FourStateTest, LosesThePredictedShare) {
  constexpr double kPackets = 1e6;
  // π₃ = π₁ p13/p31, π₄ = π₁ p14, π₂ = π₃ p32/p23.
  const double burst = model.p13 / model.p31;
  const double loss =
      (burst + model.p14) / (1.0 + model.p14 + burst * (1.0 + model.p32 / model.p23));
  EXPECT_NEAR(formula.loss_ratio(), loss, 1e-12);
  EXPECT_NEAR(ratio(losses(process(model, 1), 1, static_cast<std::size_t>(kPackets), 1000)), loss,
              kSigmas * formula.loss_ratio_sd(kPackets));
}

TEST_P(FourStateTest, HasThePredictedAutocovarianceAndBurstLength) {
  const auto all = runs(model, 100, 20'000, 1000);
  for (const std::size_t lag : {1U, 2U, 5U}) {
    const Repeated r = repeat(all, [&](const auto& lost) { return both_lost(lost, lag); });
    EXPECT_NEAR(r.mean - formula.loss_ratio() * formula.loss_ratio(),
                formula.autocovariance(static_cast<int>(lag)), kSigmas * r.mean_sd);
  }
  const Repeated burst = repeat(all, burst_length);
  EXPECT_NEAR(burst.mean, formula.mean_burst(), kSigmas * burst.mean_sd);
}

INSTANTIATE_TEST_SUITE_P(Netem, FourStateTest,
                         ::testing::Values(FourState{0.02, 0.15, 0.3, 0.6, 0.01},
                                           FourState{0.1, 0.9, 0.0, 1.0, 0.0},
                                           FourState{0.05, 0.05, 0.9, 0.2, 0.2}));

TEST(FourState, BeginsInTheGapAndJudgesAPacketByTheNewState) {
  const auto lost = losses(process(FourState{1.0, 1.0, 0.0, 1.0, 0.0}, 1), 1, 4, 0);
  EXPECT_EQ(lost, (std::vector<bool>{true, false, true, false}));
}

TEST(FourState, AnIsolatedLossIsAlwaysFollowedByAReceivedPacket) {
  const auto lost = losses(process(FourState{0.0, 1.0, 0.0, 1.0, 0.5}, 1), 1, 10'000, 0);
  EXPECT_GT(ratio(lost), 0.3);
  EXPECT_EQ(both_lost(lost, 1), 0.0);
}

TEST(FourState, WithoutStates2And4ItIsTheSimpleGilbertModel) {
  const LossStatistics four = *LossStatistics::of(FourState{0.05, 0.25, 0.0, 1.0, 0.0});
  const LossStatistics two = *LossStatistics::of(GilbertElliott{0.05, 0.25, 1.0, 0.0});
  EXPECT_NEAR(four.loss_ratio(), two.loss_ratio(), 1e-12);
  EXPECT_NEAR(four.mean_burst(), two.mean_burst(), 1e-9);
  EXPECT_NEAR(four.variance_inflation(), two.variance_inflation(), 1e-9);
}

}  // namespace
}  // namespace tether
