#include <gtest/gtest.h>

#include <algorithm>
#include <boost/random/exponential_distribution.hpp>
#include <boost/random/uniform_int_distribution.hpp>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/fit/data.hpp"
#include "netem/fit/likelihood.hpp"
#include "netem/fit/maximum.hpp"
#include "netem/fit/models.hpp"
#include "netem/fit/report.hpp"
#include "tests/netem/link/loss_rig.hpp"

namespace tether {
namespace {

using test::Chain;
using test::gilbert_elliott;

FateLog log_of(Chain chain, int packets, double interval_s = 0.05) {
  std::vector<LoggedPacket> fates;
  for (int i = 0; i < packets; ++i) fates.push_back({i * interval_s, chain.next_is_lost()});
  return fates_from_packets(std::move(fates));
}

FateLog log_of(const std::vector<int>& fates) {
  std::vector<LoggedPacket> packets;
  for (int lost : fates) packets.push_back({0.05 * static_cast<double>(packets.size()), lost == 1});
  return fates_from_packets(std::move(packets));
}

const FitParameter& parameter(const ModelFit& fit, const std::string& name) {
  for (const FitParameter& p : fit.parameters) {
    if (p.name == name) return p;
  }
  throw std::logic_error("no parameter " + name);
}

// ---------------------------------------------------------------------------- likelihood

/// P[fates] by summing over all paths of states.
double by_enumeration(const std::vector<int>& fates, const GilbertElliott& m) {
  double sum = 0.0;
  for (unsigned path = 0; path < 1U << fates.size(); ++path) {
    double probability = (path & 1U) != 0 ? m.p / (m.p + m.r) : m.r / (m.p + m.r);
    for (std::size_t i = 0; i < fates.size(); ++i) {
      const bool bad = (path >> i & 1U) != 0, next_bad = (path >> (i + 1) & 1U) != 0;
      const double loss = bad ? m.one_minus_h : m.one_minus_k;
      probability *= fates[i] == 1 ? loss : 1.0 - loss;
      if (i + 1 < fates.size()) {
        probability *= bad ? (next_bad ? 1.0 - m.r : m.r) : (next_bad ? m.p : 1.0 - m.p);
      }
    }
    sum += probability;
  }
  return sum;
}

TEST(Likelihood, IsTheSumOverAllPathsOfStates) {
  const std::vector<int> fates{0, 0, 1, 1, 1, 0, 1, 0, 0, 0};
  const GilbertElliott m{0.1, 0.3, 0.8, 0.05};
  EXPECT_NEAR(log_likelihood(RunLog(log_of(fates)), m), std::log(by_enumeration(fates, m)), 1e-12);
}

TEST(Likelihood, InTimeIsThatOfTheSampledChain) {
  const MarkovModel m{0.95, 0.3, 2.0, 0.7};
  const FateLog log = log_of(gilbert_elliott(sampled(m, 0.05), 1), 5000);
  EXPECT_NEAR(log_likelihood(log, m), log_likelihood(RunLog(log), sampled(m, 0.05)), 1e-6);
}

TEST(Likelihood, RefusesTheImpossible) {
  const RunLog log(log_of({0, 1, 0}));
  EXPECT_TRUE(std::isinf(log_likelihood(log, GilbertElliott{0.0, 1.0, 1.0, 0.0})));
}

TEST(Posterior, IsTheShareOfPathsThatAreBadThere) {
  const std::vector<int> fates{0, 1, 1, 0, 0};
  const MarkovModel m{0.9, 0.2, 0.3, 0.1};
  const GilbertElliott g = sampled(m, 0.05);
  const std::vector<double> posterior = bad_state_posterior(log_of(fates), m);
  ASSERT_EQ(posterior.size(), fates.size());
  // Probability for the first packet, by conditioning on its state: start there instead of at
  // random.
  const double pi_bad = g.p / (g.p + g.r);
  const auto given = [&](bool bad) {  // P[fates | first state], by its two continuations
    double p[2] = {bad ? 0.0 : 1.0, bad ? 1.0 : 0.0};
    for (int lost : fates) {
      const double good = p[0] * (lost == 1 ? g.one_minus_k : 1.0 - g.one_minus_k);
      const double b = p[1] * (lost == 1 ? g.one_minus_h : 1.0 - g.one_minus_h);
      p[0] = good * (1.0 - g.p) + b * g.r;
      p[1] = good * g.p + b * (1.0 - g.r);
    }
    return p[0] + p[1];
  };
  const double expected =
      pi_bad * given(true) / (pi_bad * given(true) + (1.0 - pi_bad) * given(false));
  EXPECT_NEAR(posterior[0], expected, 1e-12);
  EXPECT_GT(posterior[1], posterior[0]);
}

TEST(Maximise, FindsTheTopAndItsCurvature) {
  // −½ (x − a)ᵀ A (x − a) with A = [[4, 1], [1, 2]]: covariance A⁻¹ = [[2, −1], [−1, 4]]/7.
  const auto f = [](const Eigen::VectorXd& x) {
    const double u = x[0] - 3.0, v = x[1] + 5.0;
    return 7.0 - 0.5 * (4.0 * u * u + 2.0 * u * v + 2.0 * v * v);
  };
  const Maximum m = maximise(f, Eigen::Vector2d(0.0, 0.0));
  EXPECT_NEAR(m.at[0], 3.0, 1e-4);
  EXPECT_NEAR(m.at[1], -5.0, 1e-4);
  EXPECT_NEAR(m.value, 7.0, 1e-8);
  ASSERT_EQ(m.covariance.rows(), 2);
  EXPECT_NEAR(m.covariance(0, 0), 2.0 / 7.0, 1e-5);
  EXPECT_NEAR(m.covariance(0, 1), -1.0 / 7.0, 1e-5);
}

TEST(Maximise, SaysNothingAboutWhatTheFunctionDoesNotDetermine) {
  const auto ridge = [](const Eigen::VectorXd& x) { return -(x[0] + x[1]) * (x[0] + x[1]); };
  EXPECT_EQ(maximise(ridge, Eigen::Vector2d(1.0, 2.0)).covariance.rows(), 0);
}

// ---------------------------------------------------------------------------- recovery

constexpr int kLogs = 20;
/// 95 % intervals of 20 logs, of whatever length: P[fewer than 15 cover] = 3·10⁻⁴ by the binomial.
constexpr int kFewestCovers = 15;

TEST(FitChannel, RecoversGilbertElliottWithinItsIntervals) {
  const GilbertElliott truth{0.01, 0.08, 0.7, 0.02};
  int covers[4] = {};
  for (std::uint64_t seed = 1; seed <= kLogs; ++seed) {
    const ChannelFit fit =
        fit_channel(log_of(gilbert_elliott(truth, seed), 20000), RandomEngine(seed));
    EXPECT_EQ(fit.choice, ChannelFit::Choice::gilbert_elliott);
    EXPECT_TRUE(fit.goodness.fits()) << seed;
    ASSERT_EQ(fit.best, 4U) << "the model with four parameters";
    const double values[4] = {truth.p, truth.r, truth.one_minus_h, truth.one_minus_k};
    for (std::size_t i = 0; i < 4; ++i) {
      const FitParameter& p = fit.candidates[fit.best].parameters[i];
      covers[i] += p.low <= values[i] && values[i] <= p.high ? 1 : 0;
      EXPECT_LT(p.standard_error, 0.25 * values[i]) << p.name;
    }
  }
  for (int count : covers) EXPECT_GE(count, kFewestCovers);
}

TEST(FitChannel, RecoversGilbertsSimplestModelAndNoMore) {
  const GilbertElliott truth{0.02, 0.25, 1.0, 0.0};
  int p_covers = 0, r_covers = 0, simplest = 0;
  for (std::uint64_t seed = 1; seed <= kLogs; ++seed) {
    const ChannelFit fit =
        fit_channel(log_of(gilbert_elliott(truth, seed), 10000), RandomEngine(seed));
    const FitParameter &p = parameter(fit.candidates[1], "p"),
                       &r = parameter(fit.candidates[1], "r");
    p_covers += p.low <= truth.p && truth.p <= p.high ? 1 : 0;
    r_covers += r.low <= truth.r && truth.r <= r.high ? 1 : 0;
    simplest += fit.best == 1 ? 1 : 0;
    EXPECT_TRUE(fit.goodness.fits()) << seed;
  }
  EXPECT_GE(p_covers, kFewestCovers);
  EXPECT_GE(r_covers, kFewestCovers);
  EXPECT_GE(simplest, 18);  // BIC takes a superfluous parameter with P[χ²₁ > ln n] = 0.2 %
}

TEST(FitChannel, RecoversAProcessInTimeFromIrregularPackets) {
  const MarkovModel truth{0.98, 0.3, 2.4, 0.8};
  int covers[4] = {}, chosen = 0;
  for (std::uint64_t seed = 1; seed <= kLogs; ++seed) {
    RandomEngine random(seed);
    std::vector<LoggedPacket> packets;
    bool bad = false;
    double t = 0.0, until = 0.0;
    for (int i = 0; i < 10000; ++i) {
      // Pairs of packets, then a pause: a chain stepped by packets cannot imitate it.
      t += i % 2 == 0 ? boost::random::exponential_distribution<double>(5.0)(random) : 0.002;
      while (until < t) {
        bad = !bad;
        const double mean = bad ? truth.mean_bad_s : truth.mean_good_s;
        until += boost::random::exponential_distribution<double>(1.0 / mean)(random);
      }
      packets.push_back({t, uniform_01(random) >= (bad ? truth.prr_bad : truth.prr_good)});
    }
    const ChannelFit fit = fit_channel(fates_from_packets(packets), RandomEngine(seed));
    ASSERT_TRUE(fit.markov.has_value());
    chosen += fit.choice == ChannelFit::Choice::markov ? 1 : 0;
    EXPECT_TRUE(fit.goodness.fits()) << seed;
    const double values[4] = {truth.prr_good, truth.prr_bad, truth.mean_good_s, truth.mean_bad_s};
    for (std::size_t i = 0; i < 4; ++i) {
      const FitParameter& p = fit.markov->parameters[i];
      covers[i] += p.low <= values[i] && values[i] <= p.high ? 1 : 0;
    }
  }
  EXPECT_EQ(chosen, kLogs);
  for (int count : covers) EXPECT_GE(count, kFewestCovers);
}

TEST(FitChannel, FindsTheDelayOfEachState) {
  const MarkovModel truth{1.0, 0.2, 4.0, 2.0};
  Chain chain = gilbert_elliott(sampled(truth, 0.05), 1);
  std::vector<LoggedPacket> packets;
  for (int i = 0; i < 20000; ++i) {
    const double delay_s = chain.state == 1 ? 0.2 : 0.01;
    const bool lost = chain.next_is_lost();
    packets.push_back({0.05 * i, lost, lost ? NAN : delay_s});
  }
  const ChannelFit fit = fit_channel(fates_from_packets(packets), RandomEngine(1));
  ASSERT_TRUE(fit.markov.has_value());
  // States are distinguished by losses only, so a received packet at an edge may go to the wrong
  // one.
  EXPECT_NEAR(fit.markov->delay_good_s, 0.01, 0.005);
  EXPECT_NEAR(fit.markov->delay_bad_s, 0.2, 0.03);
}

TEST(FitChannel, CallsIndependentLossesIndependent) {
  int independent = 0;
  for (std::uint64_t seed = 1; seed <= kLogs; ++seed) {
    const ChannelFit fit =
        fit_channel(log_of(gilbert_elliott({0.0, 1.0, 1.0, 0.1}, seed), 5000), RandomEngine(seed));
    independent += fit.choice == ChannelFit::Choice::independent ? 1 : 0;
    EXPECT_TRUE(fit.goodness.fits()) << seed;
  }
  EXPECT_GE(independent, 19);
}

// ---------------------------------------------------------------------------- not Gilbert–Elliott

TEST(FitChannel, SaysThatPeriodicLossIsNotGilbertElliott) {
  std::vector<int> fates;
  for (int i = 0; i < 5000; ++i) fates.push_back(i % 10 == 3 ? 1 : 0);
  const ChannelFit fit = fit_channel(log_of(fates), RandomEngine(1));
  EXPECT_FALSE(fit.goodness.fits());
  EXPECT_NE(fit_verdict(fit).find("not Gilbert-Elliott"), std::string::npos);
}

TEST(FitChannel, SaysThatBurstsOfOneLengthAreNotGilbertElliott) {
  RandomEngine random(1);
  std::vector<int> fates;
  while (fates.size() < 10000) {
    fates.insert(fates.end(), 8, 1);
    const double gap = boost::random::exponential_distribution<double>(0.01)(random);
    fates.insert(fates.end(), 1 + static_cast<std::size_t>(gap), 0);
  }
  const ChannelFit fit = fit_channel(log_of(fates), RandomEngine(1));
  EXPECT_FALSE(fit.goodness.fits());
  EXPECT_NE(fit_verdict(fit).find("lengths of loss bursts"), std::string::npos);
}

TEST(FitChannel, SaysThatOutagesOnTwoTimeScalesAreNotGilbertElliott) {
  // Good for 200 packets on average; then bursts of 3, or, one time in five, outages of 200.
  Chain chain{{{0.995, 0.004, 0.001}, {0.333, 0.667, 0.0}, {0.005, 0.0, 0.995}},
              {0.0, 1.0, 1.0},
              RandomEngine(1),
              0};
  const ChannelFit fit = fit_channel(log_of(chain, 60000), RandomEngine(1));
  EXPECT_FALSE(fit.goodness.fits());
}

TEST(FitChannel, SaysThatAFewLossesAreTooFew) {
  std::vector<int> fates(1000, 0);
  for (int i = 0; i < 10; ++i) fates[static_cast<std::size_t>(90 * i + 7)] = 1;
  const ChannelFit fit = fit_channel(log_of(fates), RandomEngine(1));
  EXPECT_FALSE(fit.enough);
  EXPECT_EQ(fit.choice, ChannelFit::Choice::independent);
  EXPECT_NE(fit_verdict(fit).find("too few"), std::string::npos);
  EXPECT_THROW(fit_channel(log_of({0}), RandomEngine(1)), UsageError);
}

TEST(FitReport, NamesTheScenarioKeys) {
  const ChannelFit fit =
      fit_channel(log_of(gilbert_elliott({0.02, 0.25, 1.0, 0.0}, 1), 20000), RandomEngine(1));
  const std::string toml = fit_to_toml(fit, "downlink", "my.csv");
  for (const char* text :
       {"my.csv", "[channel.downlink]\n", "model = \"gilbert_elliott\"\n",
        "gilbert_elliott.p = 0.0", "gilbert_elliott.r = 0.2", "gilbert_elliott.one_minus_h = 1.0\n",
        "gilbert_elliott.one_minus_k = 0.0\n",
        "# markov.mean_good_s = ", "# markov.good.prr = 1.0\n"}) {
    EXPECT_NE(toml.find(text), std::string::npos) << text << " in\n" << toml;
  }
  EXPECT_NE(describe_fit(fit).find("* Gilbert (p, r): ln L"), std::string::npos)
      << describe_fit(fit);
}

}  // namespace
}  // namespace tether
