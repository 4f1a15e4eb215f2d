#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"

// Results of the paper, on scenarios/paper.toml as it is shipped.

namespace tether {
namespace {

double epsilon_m(const std::vector<std::string>& overrides) {
  ClosedLoop loop(load_scenario(in_source("/scenarios/paper.toml"), overrides));
  loop.run();
  return loop.sim().metrics().epsilon_m();
}

struct Sample {
  double mean_m = 0.0;
  double standard_error_m = 0.0;
};

Sample epsilon_over_seeds(const std::string& prr, int seeds) {
  double sum = 0.0, squares = 0.0;
  for (int seed = 1; seed <= seeds; ++seed) {
    const double e = epsilon_m({"channel.prr=" + prr, "run.seed=" + std::to_string(seed)});
    sum += e;
    squares += e * e;
  }
  const double mean = sum / seeds;
  const double variance = (squares - seeds * mean * mean) / (seeds - 1);
  return {mean, std::sqrt(variance / seeds)};
}

TEST(PaperBaseline, EpsilonWithoutImpairmentIsAboutOnePointEightMetres) {
  const double e = epsilon_m({});
  EXPECT_GE(e, 1.7);
  EXPECT_LE(e, 1.9);
}

TEST(PaperBaseline, OfASlowVehicleEpsilonIsFrom1Point8To2Point1MetresAtHalfASecond) {
  const auto slow_m = [](const char* delay_ms) {
    ClosedLoop loop(load_scenario(in_source("/scenarios/paper_slow.toml"),
                                  {std::string("channel.delay_ms=") + delay_ms}));
    loop.run();
    return loop.sim().metrics().epsilon_m();
  };
  EXPECT_NEAR(slow_m("0"), 1.8, 0.1);
  EXPECT_NEAR(slow_m("500"), 2.1, 0.1);
}

TEST(PaperBaseline, EpsilonRisesWithDelayAndStaysBelowTwoPointThreeMetres) {
  double previous = 0.0;
  for (const char* delay : {"0", "5", "10", "25", "50", "100", "150", "200", "250", "300", "350",
                            "400", "450", "500"}) {
    const double e = epsilon_m({std::string("channel.delay_ms=") + delay});
    EXPECT_GT(e, previous) << delay << " ms";
    EXPECT_GE(e, 1.7) << delay << " ms";
    EXPECT_LE(e, 2.3) << delay << " ms";
    previous = e;
  }
}

TEST(PaperBaseline, MeanEpsilonAtPrr045IsAboveTenMetres) {
  const Sample s = epsilon_over_seeds("0.45", 12);
  RecordProperty("mean_m", std::to_string(s.mean_m));
  // 12 seeds: the mean is above 10 m by more than two standard errors, of 2 m each.
  EXPECT_GT(s.mean_m - 2.0 * s.standard_error_m, 10.0) << s.mean_m << " ± " << s.standard_error_m;
}

TEST(PaperBaseline, MeanEpsilonAtPrr03IsOnThePlateau) {
  const Sample s = epsilon_over_seeds("0.3", 12);
  EXPECT_GT(s.mean_m + 2.0 * s.standard_error_m, 20.0) << s.mean_m << " ± " << s.standard_error_m;
  EXPECT_LT(s.mean_m - 2.0 * s.standard_error_m, 24.0) << s.mean_m << " ± " << s.standard_error_m;
  EXPECT_LT(s.standard_error_m, 2.5);
}

TEST(PaperBaseline, MeanEpsilonAtPrr085IsBelowTwoPointSixMetres) {
  // No vehicle of the first 12 seeds is lost for good.
  EXPECT_LT(epsilon_over_seeds("0.85", 12).mean_m, 2.6);
}

TEST(PaperBaseline, MeanEpsilonAtPrr01IsBetweenTwelveAndTwentyTwoMetres) {
  const Sample s = epsilon_over_seeds("0.1", 12);
  EXPECT_GT(s.mean_m - 2.0 * s.standard_error_m, 12.0) << s.mean_m << " ± " << s.standard_error_m;
  EXPECT_LT(s.mean_m + 2.0 * s.standard_error_m, 22.0) << s.mean_m << " ± " << s.standard_error_m;
}

}  // namespace
}  // namespace tether
