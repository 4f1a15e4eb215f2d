#include <gmock/gmock.h>

#include <boost/math/distributions/gamma.hpp>
#include <boost/math/distributions/lognormal.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/pareto.hpp>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/stages/delay_law.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"

// Delay laws against Boost.Math. Tolerances of samples: 5 standard deviations.

namespace tether {
namespace {

using ::testing::HasSubstr;

constexpr double kSigmas = 5.0;

JitterSettings config(const char* law, double mean_ms, double sd_ms, double shape = 3.0) {
  JitterSettings c;
  c.law = law;
  c.mean_ms = mean_ms;
  c.sd_ms = sd_ms;
  c.shape = shape;
  return c;
}

/// A law and the quantiles [ms] that it should have.
struct Case {
  const char* name;
  JitterSettings config;
  std::function<double(double p)> quantile_ms;
  double fourth_moment;  // kurtosis; 0: infinite, or heavy enough to make sample variances useless
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

double pareto_score(double p, double a) {
  const boost::math::pareto_distribution<> pareto(1.0, a);
  return (quantile(pareto, p) - mean(pareto)) / standard_deviation(pareto);
}

std::vector<Case> cases() {
  const boost::math::normal normal(3.0, 2.0);
  const boost::math::gamma_distribution<> gamma(6.25, 1.6), bursty(0.25, 40.0);
  const boost::math::lognormal lognormal(1.0, 0.6);
  return {
      {"lognormal", config("lognormal", mean(lognormal), standard_deviation(lognormal)),
       [=](double p) { return quantile(lognormal, p); }, 0.0},
      {"uniform", config("uniform", 3.0, 2.0),
       [](double p) { return 3.0 + 2.0 * std::sqrt(3.0) * (2.0 * p - 1.0); }, 1.8},
      {"normal", config("normal", 3.0, 2.0), [=](double p) { return quantile(normal, p); }, 3.0},
      {"gamma", config("gamma", 10.0, 4.0), [=](double p) { return quantile(gamma, p); },
       kurtosis(gamma)},
      {"bursty gamma", config("gamma", 10.0, 20.0), [=](double p) { return quantile(bursty, p); },
       kurtosis(bursty)},
      {"pareto of tc", config("pareto", 3.0, 2.0, 3.0),
       [](double p) { return 3.0 + 2.0 * pareto_score(p, 3.0); }, 0.0},
      {"light pareto", config("pareto", 3.0, 2.0, 50.0),
       [](double p) { return 3.0 + 2.0 * pareto_score(p, 50.0); },
       kurtosis(boost::math::pareto_distribution<>(1.0, 50.0))},
  };
}

struct DelayLawTest : ::testing::TestWithParam<Case> {
  DelayLaw law{GetParam().config, {}};
};

TEST_P(DelayLawTest, HasTheQuantilesOfBoostMath) {
  const boost::math::normal standard;
  for (const double p :
       {1e-9, 1e-6, 1e-3, 0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 0.999, 1 - 1e-6}) {
    const double expected_ms = GetParam().quantile_ms(p);
    EXPECT_NEAR(1e3 * law.at_score(quantile(standard, p)), expected_ms,
                1e-4 * std::max(std::abs(expected_ms), 1e-3 * GetParam().config.sd_ms))
        << "p = " << p;
  }
}

TEST_P(DelayLawTest, NeverFallsWithTheScore) {
  double before = law.at_score(-8.3);
  for (double z = -8.3; z <= 8.3; z += 0.001) {
    const double x = law.at_score(z);
    ASSERT_GE(x, before) << z;
    before = x;
  }
}

TEST_P(DelayLawTest, SamplesHaveItsQuantilesMeanAndVariance) {
  constexpr int kDelays = 400'000;
  DelaySequence sequence(law, 0.0, random_stream(1, "delay"));
  std::vector<double> ms;
  for (int i = 0; i < kDelays; ++i) ms.push_back(1e3 * to_seconds(sequence.next()));
  for (const double p : {0.001, 0.1, 0.5, 0.9, 0.99, 0.9999}) {
    const double limit = GetParam().quantile_ms(p);
    if (std::abs(limit) < 1e-3) continue;  // 1 us: sequences round to 1 ns
    const auto below = std::count_if(ms.begin(), ms.end(), [&](double x) { return x <= limit; });
    EXPECT_NEAR(static_cast<double>(below) / kDelays, p,
                kSigmas * std::sqrt(p * (1.0 - p) / kDelays));
  }
  const auto& [name, config, unused, fourth] = GetParam();
  if (fourth == 0.0) return;
  double sum = 0.0, squares = 0.0;
  for (const double x : ms) sum += x;
  const double mean_ms = sum / kDelays;
  for (const double x : ms) squares += (x - mean_ms) * (x - mean_ms);
  const double variance = config.sd_ms * config.sd_ms;
  EXPECT_NEAR(mean_ms, config.mean_ms, kSigmas * config.sd_ms / std::sqrt(kDelays));
  // Var(s²) ≈ σ⁴ (κ − 1)/n.
  EXPECT_NEAR(squares / kDelays, variance,
              kSigmas * variance * std::sqrt((fourth - 1.0) / kDelays));
}

INSTANTIATE_TEST_SUITE_P(Netem, DelayLawTest, ::testing::ValuesIn(cases()));

/// ∫ f(x(z)) φ(z) dz by the trapezoidal rule, which is exact to all digits that count here.
double expectation(const DelayLaw& law, const std::function<double(double)>& f) {
  double sum = 0.0;
  for (double z = -8.3; z <= 8.3; z += 0.001) {
    sum += f(law.at_score(z)) * std::exp(-0.5 * z * z) * 0.001;
  }
  return sum / std::sqrt(2.0 * std::numbers::pi);
}

TEST(DelayLaw, ParetonormalIsAQuarterNormalAndThreeQuartersOfTcsPareto) {
  const DelayLaw law(config("paretonormal", 3.0, 2.0), {});
  EXPECT_NEAR(expectation(law, [](double x) { return x; }), 3e-3, 1e-8);
  EXPECT_NEAR(expectation(law, [](double x) { return (x - 3e-3) * (x - 3e-3); }), 4e-6, 1e-11);
  const auto w = [](double p) {
    const boost::math::pareto_distribution<> pareto(1.0, 3.0);
    return 0.25 * quantile(boost::math::normal(), p) +
           0.75 * 4.0 / 3.0 * (quantile(pareto, p) - mean(pareto));
  };
  const double scale = (law.at_score(0.0) - 3e-3) / w(0.5);
  for (const double p : {1e-6, 0.01, 0.3, 0.9, 0.999}) {
    EXPECT_NEAR(law.at_score(quantile(boost::math::normal(), p)), 3e-3 + scale * w(p), 1e-9);
  }
}

TEST(DelayLaw, OfAConstantIsTheConstant) {
  DelaySequence sequence(DelayLaw(config("constant", 12.5, 0.0), {}), 0.0, {});
  for (int i = 0; i < 10; ++i) EXPECT_EQ(sequence.next(), std::chrono::microseconds{12500});
}

TEST(DelayLaw, OfATableIsLinearBetweenItsQuantiles) {
  const DelayLaw law(config("table", 0.0, 0.0), {1.0, 3.0, 103.0});
  const boost::math::normal standard;
  EXPECT_NEAR(law.at_score(-8.3), 1e-3, 1e-12);
  EXPECT_NEAR(law.at_score(quantile(standard, 0.25)), 2e-3, 1e-12);
  EXPECT_NEAR(law.at_score(0.0), 3e-3, 1e-12);
  EXPECT_NEAR(law.at_score(quantile(standard, 0.95)), 93e-3, 1e-12);
  EXPECT_NEAR(law.at_score(8.3), 103e-3, 1e-12);
}

TEST(DrawNormalScore, IsTheInverseNormalDistributionOfEachDraw) {
  RandomEngine scores = random_stream(1, "delay"), raw = random_stream(1, "delay");
  const boost::math::normal standard;
  for (int i = 0; i < 300'000; ++i) {
    const double u = (static_cast<double>(raw() >> 12) + 0.5) * 0x1p-52;
    const double expected =
        u < 0.5 ? quantile(standard, u) : quantile(boost::math::complement(standard, 1.0 - u));
    ASSERT_NEAR(draw_normal_score(scores), expected, 2e-15 * (1.0 + std::abs(expected)));
  }
}

// -------------------------------------------------------------------- correlation

TEST(DelaySequence, NormalDelaysAreAnAutoregressiveProcess) {
  constexpr int kDelays = 400'000;
  for (const double c : {0.3, 0.9, -0.5}) {
    DelaySequence sequence(DelayLaw(config("normal", 0.0, 1.0), {}), c, random_stream(2, "delay"));
    std::vector<double> z;
    for (int i = 0; i < kDelays; ++i) z.push_back(1e3 * to_seconds(sequence.next()));
    for (const int k : {1, 2, 5}) {
      double products = 0.0, squares = 0.0;
      for (std::size_t i = 0; i + static_cast<std::size_t>(k) < z.size(); ++i) {
        products += z[i] * z[i + static_cast<std::size_t>(k)];
        squares += z[i] * z[i];
      }
      // Bartlett: n Var(ρ_k) = (1+c²)(1−c^2k)/(1−c²) − 2k c^2k for a first-order autoregression.
      const double square = std::pow(c, 2 * k);
      const double variance =
          ((1.0 + c * c) * (1.0 - square) / (1.0 - c * c) - 2.0 * k * square) / kDelays;
      EXPECT_NEAR(products / squares, std::pow(c, k), kSigmas * std::sqrt(variance))
          << "c = " << c << ", lag " << k;
    }
  }
}

TEST(DelaySequence, UniformDelaysHaveTheRankCorrelationOfAGaussianCopula) {
  constexpr int kDelays = 400'000;
  constexpr double kCorrelation = 0.8;
  DelaySequence sequence(DelayLaw(config("uniform", 0.0, 1.0), {}), kCorrelation,
                         random_stream(2, "delay"));
  double products = 0.0, before = 1e3 * to_seconds(sequence.next());
  for (int i = 0; i < kDelays; ++i) {
    const double x = 1e3 * to_seconds(sequence.next());
    products += before * x;
    before = x;
  }
  // |x| ≤ √3, so Var(x_i x_{i+1}) ≤ E x_i² x_{i+1}² ≤ 1.8; products are correlated at lag k with
  // less than c^2k·1.8, which inflates the variance of their mean by (1+c²)/(1−c²) at most.
  const double square = kCorrelation * kCorrelation;
  const double sd = std::sqrt(1.8 * (1.0 + square) / (1.0 - square) / kDelays);
  EXPECT_NEAR(products / kDelays, 6.0 / std::numbers::pi * std::asin(kCorrelation / 2.0),
              kSigmas * sd);
}

TEST(DelaySequence, CorrelationLeavesTheLawAsItIs) {
  // One delay each of many sequences, the 20th: independent of each other.
  constexpr int kSequences = 4000;
  const DelayLaw law(config("gamma", 10.0, 4.0), {});
  const boost::math::gamma_distribution<> gamma(6.25, 1.6);
  int below[3] = {};
  const double levels[3] = {0.1, 0.5, 0.95};
  for (std::uint64_t seed = 0; seed < kSequences; ++seed) {
    DelaySequence sequence(law, 0.95, random_stream(seed, "delay"));
    Duration delay{0};
    for (int i = 0; i < 20; ++i) delay = sequence.next();
    for (int i = 0; i < 3; ++i) {
      below[i] += 1e3 * to_seconds(delay) <= quantile(gamma, levels[i]) ? 1 : 0;
    }
  }
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(below[i], kSequences * levels[i],
                kSigmas * std::sqrt(kSequences * levels[i] * (1.0 - levels[i])));
  }
}

TEST(DelaySequence, EveryDelayTakesOneDrawWhateverTheLaw) {
  for (const char* kind : {"uniform", "pareto", "gamma"}) {
    const DelayLaw law(config(kind, 5.0, 1.0), {});
    DelaySequence sequence(law, 0.5, random_stream(1, "delay"));
    DelaySequence normal(DelayLaw(config("normal", 0.0, 1e3), {}), 0.5, random_stream(1, "delay"));
    for (int i = 0; i < 1000; ++i) {
      // Normal delays with a standard deviation of 1 s are the scores, to 1 ns.
      ASSERT_NEAR(to_seconds(sequence.next()), law.at_score(to_seconds(normal.next())), 2e-9) << i;
    }
  }
}

// -------------------------------------------------------------------- table files

struct DelayTableFile : ::testing::Test {
  const test::Folder folder;

  JitterSettings written(const std::string& text) const {
    JitterSettings c = config("table", 0.0, 0.0);
    c.file = folder.file("delays.txt", text).string();
    return c;
  }
  std::string refusal(const JitterSettings& c) const {
    return refusal_of([&] { load_delay_table(c); });
  }
};

TEST_F(DelayTableFile, IsReadAndSorted) {
  EXPECT_EQ(load_delay_table(written("# ping\n 3.5 \n\n-1e0\r\n2")),
            (std::vector<double>{-1.0, 2.0, 3.5}));
}

TEST_F(DelayTableFile, IsRefusedWithFileAndLine) {
  EXPECT_THAT(refusal(written("1\n2 ms\n")), HasSubstr("delays.txt:2: \"2 ms\" is not a delay"));
  EXPECT_THAT(refusal(written("1\nnan\n")), HasSubstr("delays.txt:2: "));
  EXPECT_THAT(refusal(written("1\n")), HasSubstr("two or more"));
  JitterSettings missing = written("");
  missing.file += "x";
  EXPECT_THAT(refusal(missing), HasSubstr("cannot read the delay table"));
}

}  // namespace
}  // namespace tether
