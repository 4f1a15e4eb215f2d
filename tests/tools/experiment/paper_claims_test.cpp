#include <gmock/gmock.h>

#include <atomic>
#include <thread>

#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/experiment/report/claims.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/experiment/sweep/sweep.hpp"

// The paper's claims, by the shipped experiments on the kinematic plant, with as many seeds as
// `tether reproduce` has where verdicts need them. Seeds are fixed and runs are deterministic, so
// the tolerance is in the claims: docs/explanation/reproduction.md has the same with the ODE plant.

namespace tether {
namespace {

using ::testing::HasSubstr;

class PaperClaims : public ::testing::Test {
 protected:
  static RunStore sweep(const std::filesystem::path& folder, const std::string& name, bool quick,
                        std::vector<std::string> overrides = {}) {
    overrides.emplace_back("vehicle.plant=kinematic");
    const Experiment experiment =
        load_experiment(in_source("/experiments/") + name + ".toml", overrides, quick);
    RunStore store = RunStore::begin(folder / name, experiment, {});
    const std::atomic<bool> stop{false};
    const SweepOptions options{std::thread::hardware_concurrency(), {}, {}, run_once};
    EXPECT_TRUE(run_sweep(experiment, {}, store, options, stop).is_complete);
    EXPECT_EQ(store.failures(), 0U);
    return store;
  }

  static void SetUpTestSuite() {
    const test::Folder folder;
    results_ = std::make_unique<PaperResults>();
    const RunStore prr = sweep(folder.path, "f2_prr", false);
    results_->prr.emplace(prr, "epsilon_m");
    results_->prr_by_command = by_command(prr);
    results_->delay.emplace(sweep(folder.path, "f3_delay", true), "epsilon_m");
    results_->heatmap.emplace(sweep(folder.path, "f4_tau", true), "epsilon_m");
    results_->risk = risk_fall(sweep(folder.path, "f5_risk", false), RiskDefinition::whole_run);
  }
  static void TearDownTestSuite() { results_.reset(); }

  static Claim claim(const std::string& paper) {
    for (const Claim& claim : judge_claims(*results_)) {
      if (claim.paper.find(paper) != std::string::npos) return claim;
    }
    ADD_FAILURE() << "no claim about " << paper;
    return {};
  }
  static void expect_reproduced(const std::string& paper) {
    const Claim found = claim(paper);
    EXPECT_EQ(to_text(found.verdict), "reproduced") << paper << ": " << found.ours;
  }
  static void expect_not_reproduced(const std::string& paper, const std::string& ours) {
    const Claim found = claim(paper);
    EXPECT_EQ(to_text(found.verdict), "not reproduced") << paper << ": " << found.ours;
    EXPECT_THAT(found.ours, HasSubstr(ours));
  }
  static double mean_m(double prr) {
    return results_->prr->arms()[results_->prr->find({{"channel.prr", prr}}).value()].summary.mean;
  }

  static inline std::unique_ptr<PaperResults> results_;
};

TEST_F(PaperClaims, WithoutImpairmentTheErrorIsAbout1Point8Metres) {
  expect_reproduced("at PRR 1, τ = 2 s");
}

TEST_F(PaperClaims, OnThePlateauTheMeanErrorIsUpToAbout23Metres) {
  expect_reproduced("plateau, PRR");
}

TEST_F(PaperClaims, OnThePlateauSingleRunsOfThisPlantStayBelow28Point5Metres) {
  // With the ODE plant the largest is 29.0 m, which reproduces the claim.
  expect_not_reproduced("single runs", "the largest of 300 runs is 28.1 m");
}

TEST_F(PaperClaims, AtPrr085TheMeanErrorIsBelow2Point6Metres) {
  // One vehicle of 60 is lost, so that the interval reaches farther.
  EXPECT_LT(mean_m(0.85), 2.6);
  EXPECT_GT(mean_m(0.85), mean_m(1.0));
}

TEST_F(PaperClaims, AtPrr01AndBelowTheMeanErrorIsAbove15Metres) {
  expect_not_reproduced("15 m at PRR ≤ 0.1", "PRR 0.1: 17.3");
  // 26 of 60 never get a command, where chance gives 32: the plain mean is higher still.
  EXPECT_NEAR(mean_m(0.1), 17.8, 0.1);
}

TEST_F(PaperClaims, TheErrorIsLargestInTheMiddleOfThePrrs) { expect_reproduced("bell shape"); }

TEST_F(PaperClaims, TheErrorRisesWithDelayFartherThanThePapersAndNotInAStraightLine) {
  expect_not_reproduced("at 500 ms", "2.28");
  expect_not_reproduced("over 500 ms", "by 0.547");
  // Never falls, but no straight line.
  const Claim rise = claim("ε rises with δ");
  EXPECT_THAT(rise.reason, HasSubstr("it rises, but not in a straight line"));
}

TEST_F(PaperClaims, LossHurtsMoreThanDelay) { expect_reproduced("loss hurts"); }

TEST_F(PaperClaims, WithoutLossALookAheadOf2SecondsIsTheBestAndTheErrorRisesOnBothSides) {
  expect_reproduced("at PRR 1 the best τ is 2 s");
}

TEST_F(PaperClaims, ASlowVehiclesErrorRisesWithDelayAsThePapers) {
  // scenarios/paper_slow.toml; nothing is random here.
  const test::Folder folder;
  PaperResults slow;
  slow.delay.emplace(sweep(folder.path, "f3_delay", true,
                           {"controller.v.limit=2.8", "controller.v.p=0.48", "controller.v.d=0"}),
                     "epsilon_m");
  const auto claims = judge_claims(slow);
  EXPECT_EQ(claims.size(), 3U);
  for (const Claim& claim : claims) {
    EXPECT_EQ(to_text(claim.verdict), "reproduced") << claim.paper << ": " << claim.ours;
  }
}

TEST_F(PaperClaims, TheRiskFallsAlongThePath) { expect_reproduced("the risk falls"); }

TEST_F(PaperClaims, TheRiskIsHighBeforeTheFirstTurns) {
  expect_reproduced("before the first turns");
}

}  // namespace
}  // namespace tether
