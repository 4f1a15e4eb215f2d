#include "tools/experiment/report/claims.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <filesystem>

#include "tests/tools/runs/run_files.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using Verdict = Claim::Verdict;

/// ε of the n-th run at two values of the grid.
using Epsilon = std::function<double(double x, double y, std::size_t n)>;

class Claims : public ::testing::Test {
 protected:
  /// A sweep with made-up results.
  SweepData data(const std::vector<std::string>& keys, const std::vector<std::vector<double>>& grid,
                 std::size_t seeds, const Epsilon& epsilon) {
    const auto file = folder_.path / fmt::format("{}.sqlite", stores_++);
    Experiment e;
    e.name = "made_up";
    e.keys = keys;
    for (const auto& point : grid) {
      Arm arm;
      for (std::size_t i = 0; i < keys.size(); ++i) {
        arm.settings.push_back({keys[i], fmt::format("{}", point[i])});
      }
      e.arms.push_back(arm);
    }
    for (std::size_t n = 1; n <= seeds; ++n) e.seeds.push_back(n);
    RunStore store = RunStore::begin(file, e, {});
    std::vector<StoredRun> runs;
    for (std::size_t arm = 0; arm < grid.size(); ++arm) {
      for (std::size_t n = 1; n <= seeds; ++n) {
        RunResult result;
        result.metrics[0] = epsilon(grid[arm][0], grid[arm].back(), n);
        runs.push_back({arm, n, result});
      }
    }
    store.add(runs);
    return {store, "epsilon_m"};
  }
  SweepData by_prr(const Epsilon& epsilon, std::size_t seeds = 20,
                   const std::vector<double>& prrs = {0.05, 0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 0.85,
                                                      1.0}) {
    std::vector<std::vector<double>> grid;
    for (const double prr : prrs) grid.push_back({prr});
    return data({"channel.prr"}, grid, seeds, epsilon);
  }
  static Claim find(const std::vector<Claim>& claims, const std::string& paper) {
    for (const Claim& claim : claims) {
      if (claim.paper.find(paper) != std::string::npos) return claim;
    }
    ADD_FAILURE() << "no claim about " << paper;
    return {};
  }

 private:
  test::Folder folder_;
  int stores_ = 0;
};

/// Within ±0.5 m.
double spread(std::size_t n) { return 0.1 * static_cast<double>(n % 11) - 0.5; }

double as_in_the_paper(double prr, double, std::size_t n) {
  if (prr <= 0.1) return 15.0 + spread(n);
  if (prr <= 0.4) return n == 7 ? 29.0 : 22.0 + spread(n);
  return prr < 1.0 ? 2.0 + 0.1 * spread(n) : 1.8;
}

TEST_F(Claims, AreReproducedByThePapersOwnNumbers) {
  PaperResults results;
  results.prr.emplace(by_prr(as_in_the_paper));
  const auto claims = judge_claims(results);
  EXPECT_GE(claims.size(), 6U);
  for (const Claim& claim : claims) {
    EXPECT_EQ(claim.verdict, Verdict::reproduced) << claim.paper << ": " << claim.ours;
  }
}

TEST_F(Claims, AreNotReproducedByOtherNumbers) {
  PaperResults results;
  results.prr.emplace(
      by_prr([](double prr, double, std::size_t n) { return 5.0 + prr + 0.1 * spread(n); }, 40));
  for (const Claim& claim : judge_claims(results)) {
    EXPECT_EQ(claim.verdict, Verdict::not_reproduced) << claim.paper << ": " << claim.ours;
    EXPECT_NE(claim.reason, "") << claim.paper;
  }
}

TEST_F(Claims, AreUndecidedWhereTheIntervalReachesBeyondThem) {
  PaperResults results;
  results.prr.emplace(by_prr(
      [](double prr, double, std::size_t n) {
        return prr == 0.85 ? (n % 4 == 0 ? 8.0 : 1.0) : as_in_the_paper(prr, 0.0, n);
      },
      12));
  const Claim claim = find(judge_claims(results), "PRR 0.85");
  EXPECT_EQ(claim.verdict, Verdict::undecided);
  EXPECT_THAT(claim.ours, HasSubstr("n = 12"));
  EXPECT_NE(claim.reason, "");
}

TEST_F(Claims, AboutDelayWantARiseInAStraightLine) {
  const auto judge = [this](const Epsilon& epsilon) {
    PaperResults results;
    results.delay.emplace(
        data({"channel.delay_ms"}, {{0}, {100}, {200}, {300}, {400}, {500}}, 6, epsilon));
    return find(judge_claims(results), "rises with").verdict;
  };
  EXPECT_EQ(judge([](double ms, double, std::size_t) { return 1.8 + 0.0006 * ms; }),
            Verdict::reproduced);
  EXPECT_EQ(judge([](double ms, double, std::size_t) { return 1.8 - 0.0006 * ms; }),
            Verdict::not_reproduced);
  EXPECT_EQ(judge([](double ms, double, std::size_t) { return ms > 450 ? 2.1 : 1.8; }),
            Verdict::not_reproduced);
}

TEST_F(Claims, AboutTheRiseWithDelayWantTheRiseItselfWithinItsBand) {
  const auto judge = [this](double rise_m, const std::string& claim) {
    PaperResults results;
    results.delay.emplace(
        data({"channel.delay_ms"}, {{0}, {250}, {500}}, 6,
             [rise_m](double ms, double, std::size_t) { return 1.75 + rise_m * ms / 500.0; }));
    return find(judge_claims(results), claim).verdict;
  };
  EXPECT_EQ(judge(0.3, "over 500 ms"), Verdict::reproduced);
  // An error that ends where the paper's does, but rises faster.
  EXPECT_EQ(judge(0.44, "at 500 ms"), Verdict::reproduced);
  EXPECT_EQ(judge(0.44, "over 500 ms"), Verdict::not_reproduced);
  EXPECT_EQ(judge(0.1, "over 500 ms"), Verdict::not_reproduced);
}

TEST_F(Claims, AboutThePlateauWantItsLargestMeanWithinTheBand) {
  const auto judge = [this](double shift_m) {
    PaperResults results;
    results.prr.emplace(by_prr([shift_m](double prr, double, std::size_t n) {
      return as_in_the_paper(prr, 0.0, n) + (prr == 0.25 ? shift_m : 0.0);
    }));
    return find(judge_claims(results), "plateau, PRR").verdict;
  };
  EXPECT_EQ(judge(0.0), Verdict::reproduced);
  EXPECT_EQ(judge(4.0), Verdict::not_reproduced);
}

TEST_F(Claims, AboutTheBestLookAheadNeedItToBeSeparated) {
  std::vector<std::vector<double>> grid;
  for (const double prr : {0.45, 0.65, 1.0}) {
    for (const double tau : {1.0, 2.0, 3.0}) grid.push_back({prr, tau});
  }
  PaperResults results;
  results.heatmap.emplace(data(
      {"channel.prr", "controller.tau_s"}, grid, 12, [](double prr, double tau, std::size_t n) {
        if (prr == 1.0) return 1.8 + std::abs(tau - 2.0) + 0.1 * spread(n);    // clear
        if (prr == 0.65) return 10.0 + std::abs(tau - 1.0) + 0.1 * spread(n);  // clear, and 1 s
        return 20.0 + spread(static_cast<std::size_t>(tau * 5.0) + 3 * n);     // flat
      }));
  const auto claims = judge_claims(results);
  EXPECT_EQ(find(claims, "at PRR 1 ").verdict, Verdict::reproduced);
  EXPECT_EQ(find(claims, "at PRR 0.65").verdict, Verdict::not_reproduced);
  EXPECT_EQ(find(claims, "at PRR 0.45").verdict, Verdict::undecided);
}

TEST_F(Claims, AboutBothSidesOfTheBestLookAheadWantEachStepToRise) {
  const auto judge = [this](double at_4_s) {
    std::vector<std::vector<double>> grid;
    for (const double tau : {4.0, 1.0, 3.0, 2.0}) grid.push_back({1.0, tau});
    PaperResults results;
    results.heatmap.emplace(
        data({"channel.prr", "controller.tau_s"}, grid, 12, [&](double, double tau, std::size_t n) {
          return (tau == 4.0 ? at_4_s : 1.8 + std::abs(tau - 2.0)) + 0.1 * spread(n);
        }));
    return find(judge_claims(results), "at PRR 1 ");
  };
  EXPECT_EQ(judge(4.0).verdict, Verdict::reproduced);
  EXPECT_EQ(judge(2.8).verdict, Verdict::undecided);  // same as at 3 s
  EXPECT_EQ(judge(2.3).verdict, Verdict::not_reproduced);
  EXPECT_EQ(judge(2.3).reason, "it does not rise on both sides");
}

TEST_F(Claims, AboutTheRiskNeedAFallBeyondChance) {
  const auto judge = [](const Interval& to_second, const Interval& to_last) {
    PaperResults results;
    results.risk = RiskFall{};
    results.risk->to_second = {0.0, to_second};
    results.risk->to_last = {0.0, to_last};
    return find(judge_claims(results), "risk falls").verdict;
  };
  EXPECT_EQ(judge({1, 7}, {2, 10}), Verdict::reproduced);
  EXPECT_EQ(judge({-1, 9}, {2, 10}), Verdict::undecided);
  EXPECT_EQ(judge({-4, -1}, {-9, -2}), Verdict::not_reproduced);
  EXPECT_EQ(judge({-4, -1}, {2, 10}), Verdict::not_reproduced);
}

TEST_F(Claims, AboutTheRiskBeforeTurnsCompareItWithTheRest) {
  PaperResults results;
  results.risk = RiskFall{};
  results.risk->to_rest = {3.0, {1.0, 5.0}};
  EXPECT_EQ(find(judge_claims(results), "before the first turns").verdict, Verdict::reproduced);
  results.risk->to_rest = {-3.0, {-5.0, -1.0}};
  results.risk->definition = RiskDefinition::now;
  const Claim claim = find(judge_claims(results), "before the first turns");
  EXPECT_EQ(claim.verdict, Verdict::not_reproduced);
  EXPECT_THAT(claim.reason, HasSubstr("--risk"));
}

TEST_F(Claims, SayWhatIsMissing) {
  PaperResults results;
  results.prr.emplace(by_prr(as_in_the_paper, 20, {0.05, 0.1, 0.2, 0.3, 0.4, 0.85, 1.0}));
  const Claim claim = find(judge_claims(results), "plateau, PRR");
  EXPECT_EQ(claim.verdict, Verdict::undecided);
  EXPECT_EQ(claim.reason, "no runs at 0.25, 0.35");
}

TEST_F(Claims, AreNotJudgedWithoutResults) { EXPECT_TRUE(judge_claims({}).empty()); }

}  // namespace
}  // namespace tether
