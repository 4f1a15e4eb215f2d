#include "tools/margin/verification.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/source_dir.hpp"
#include "tools/experiment/sweep/experiment.hpp"

// A small part of experiments/margins.toml: what is computed against what simulations have.
// `tether margin --verify` has the rest, 16 minutes on two cores.

namespace tether {
namespace {

VerificationTrial small() {
  VerificationTrial trial;
  trial.seeds = 4;
  trial.linear_loops = 300;
  trial.linear_periods = 300;
  trial.full_loops = 80;
  trial.full_periods = 50;
  return trial;
}

/// The bars are those of the whole experiment. The intervals of so few runs are wider: half widths
/// up to 5 %, values off by up to 2 %.
void expect_within_bars(const std::string& law, const std::string& rate,
                        const std::string& channel) {
  const Experiment experiment = load_experiment(in_source("/experiments/margins.toml"));
  for (const Arm& arm : experiment.arms) {
    const auto& s = arm.settings;
    if (s[0].plain() != law || s[1].plain() != rate || s[2].plain() != channel) continue;
    for (const VerifiedCritical& row : verify_margins(arm.scenario, small())) {
      const bool is_prr = row.quantity == VerifiedCritical::Quantity::prr;
      SCOPED_TRACE(arm.text() + (is_prr ? " prr" : " delay"));
      ASSERT_TRUE(row.predicted && row.linear) << row.why;
      EXPECT_NEAR(row.off(row.linear), 0.0, 0.05);
      if (!row.why.empty()) continue;
      ASSERT_TRUE(row.full);
      EXPECT_NEAR(row.off(row.full), 0.0, 0.15) << *row.predicted;
    }
    return;
  }
  FAIL() << "no such arm";
}

TEST(VerificationTest, TrackingAtTheEightsTopSpeedHasItsCriticalPrrAndDelay) {
  expect_within_bars("tracking, 2.87 m/s", "20", "independent");
}

// With delay and loss together errors along the straight settle slowly.
TEST(VerificationTest, TrackingWithLossesInBurstsHasItsCriticalPrrAndDelay) {
  expect_within_bars("tracking, 1.5 m/s", "10", "four states");
}

/// 80 runs of 320 s, with a mean of some 140 s.
TEST(VerificationTest, WithNoiseWholeRunsLeaveThePathAsSoonAsIsPredicted) {
  const Experiment experiment = load_experiment(in_source("/experiments/margins.toml"));
  for (const Arm& arm : experiment.arms) {
    const auto& s = arm.settings;
    if (s[0].plain() != "tracking, 2.87 m/s, noise" || s[1].plain() != "20" ||
        s[2].plain() != "independent") {
      continue;
    }
    const auto rows = verify_margins(arm.scenario, small());
    ASSERT_EQ(rows.size(), 1u);
    ASSERT_TRUE(rows[0].predicted && rows[0].full) << rows[0].why;
    EXPECT_TRUE(rows[0].holds()) << rows[0].linear->low << " to " << rows[0].linear->high << ", "
                                 << rows[0].full->low << " to " << rows[0].full->high;
    EXPECT_LT(rows[0].full->high, 2.0 * rows[0].full->low);
    return;
  }
  FAIL() << "no such arm";
}

TEST(VerificationTest, OnTheEightThereIsAReasonInsteadOfANumber) {
  const Scenario eight = load_scenario(in_source("/scenarios/paper.toml"),
                                       {"controller.law=tracking", "sensor.rate_hz=20"});
  VerificationTrial trial = small();
  for (const VerifiedCritical& row : verify_margins(eight, trial)) {
    EXPECT_FALSE(row.full);
    EXPECT_NE(row.why.find("the path's speed varies"), std::string::npos) << row.why;
    EXPECT_TRUE(row.holds());
  }
}

}  // namespace
}  // namespace tether
