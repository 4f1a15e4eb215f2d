#include "tools/margin/design_search.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/margin/straight_loop.hpp"

// tether margin --find: the answer is what was asked for, and runs with other luck agree with it.

namespace tether {
namespace {

const std::string kPaper = in_source("/scenarios/paper.toml");

using Settings = std::vector<std::string>;

Settings operator+(Settings a, const Settings& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Settings noisy(const std::string& law) {
  return {"controller.law=" + law, "vehicle.plant=kinematic", "sensor.position_noise_m=0.02",
          "sensor.yaw_noise_rad=0.01"};
}

DesignQuestion question(const std::string& what, const Settings& settings, double target_m) {
  return {kPaper, settings, what, target_m, 8, 2};
}

double predicted_m(const Settings& settings) {
  const StraightLoop loop(load_scenario(kPaper, settings));
  return loop.rms_m(loop.chain()).value();
}

TEST(FindRateTest, TheAnswerIsTheFirstWhoseRunsMeetTheTarget) {
  const Settings set = noisy("tracking") + Settings{"channel.prr=0.7"};
  const DesignAnswer answer = find_design(question("rate", set, 0.1));
  ASSERT_TRUE(answer.found()) << answer.why_none;
  for (std::size_t i = 0; i + 1 < answer.tried.size(); ++i) EXPECT_FALSE(answer.tried[i].good);
  const SettledError& found = answer.tried.back().simulated;
  EXPECT_LE(found.mean_m + found.half_width_m, 0.1);
  EXPECT_EQ(answer.tried.back().set, Settings{"sensor.rate_hz=16"});
  // 8 of these 60 runs chose it.
  const SettledError again =
      settled_error(load_scenario(kPaper, set + answer.tried.back().set), 60, 2);
  EXPECT_LE(again.mean_m + again.half_width_m, 0.1);
}

TEST(FindRateTest, ATargetBelowTheNoiseHasNoAnswer) {
  const DesignAnswer answer = find_design(question("rate", noisy("tracking"), 1e-4));
  EXPECT_FALSE(answer.found());
  EXPECT_TRUE(answer.tried.empty());
  EXPECT_NE(answer.why_none.find("no rate up to 100 Hz"), std::string::npos) << answer.why_none;
}

TEST(FindRateTest, RatesThatAChainsStepsDoNotFitAreLeftOut) {
  const Settings set =
      noisy("tracking") +
      Settings{"sensor.rate_hz=20", "channel.model=chain", "channel.chain.prr=[1.0, 0.0]",
               "channel.chain.probabilities=[[0.9, 0.1], [0.4, 0.6]]", "channel.chain.step_s=0.05"};
  const DesignAnswer answer = find_design(question("rate", set, 0.03));
  ASSERT_TRUE(answer.found()) << answer.why_none;
  EXPECT_EQ(answer.tried.back().set, Settings{"sensor.rate_hz=20"});
}

TEST(FindRateTest, OfPlansIsTheLowestAtWhichTheyAreLongerThanSilences) {
  const DesignAnswer answer =
      find_design(question("rate",
                           noisy("predictive") + Settings{"actuator.policy=horizon",
                                                          "channel.prr=0.5", "sensor.rate_hz=20"},
                           0.1));
  ASSERT_TRUE(answer.found()) << answer.why_none;
  EXPECT_EQ(answer.tried.back().set, Settings{"sensor.rate_hz=2"});
}

TEST(FindTauTest, TheAnswerHasALowerPredictedErrorThanItsNeighbours) {
  const Settings set = noisy("pid") + Settings{"controller.v.d=0",       "controller.omega.d=0",
                                               "sensor.rate_hz=20",      "sensor.latency_ms=100",
                                               "controller.v.p=1",       "path.kind=line",
                                               "path.length_m=100",      "path.speed_mps=1.5",
                                               "world.half_extent_m=500"};
  const DesignAnswer answer = find_design(question("tau", set, 0.2));
  ASSERT_EQ(answer.tried.size(), 1U) << answer.why_none;
  ASSERT_EQ(answer.tried[0].set.size(), 1U);
  EXPECT_EQ(answer.tried[0].set[0], "controller.tau_s=0.9");
  const double best_m = predicted_m(set + answer.tried[0].set);
  EXPECT_LT(best_m, predicted_m(set + Settings{"controller.tau_s=0.85"}));
  EXPECT_LT(best_m, predicted_m(set + Settings{"controller.tau_s=0.95"}));
}

TEST(FindGainsTest, TheAnswerIsBetterThanTheScenariosOwnByTheoryAndByRuns) {
  const Settings set = noisy("tracking") + Settings{"sensor.rate_hz=20", "channel.prr=0.7"};
  const DesignAnswer answer = find_design(question("gains", set, 0.1));
  ASSERT_TRUE(answer.found()) << answer.why_none;
  EXPECT_LT(predicted_m(set + answer.tried[0].set), predicted_m(set));
}

TEST(FindHorizonTest, MoreLossNeedsALongerOne) {
  const auto horizon_s = [](const std::string& prr) {
    const DesignAnswer answer =
        find_design(question("horizon",
                             {"controller.law=predictive", "actuator.policy=horizon",
                              "vehicle.plant=kinematic", "sensor.rate_hz=10", "channel.prr=" + prr},
                             0.3));
    EXPECT_TRUE(answer.found()) << answer.why_none;
    const std::string& set = answer.tried.back().set.front();
    return std::stod(set.substr(set.find('=') + 1));
  };
  // Independent losses: one in 1000 silences is longer than ln 1000 / -ln(1 - p²) periods.
  EXPECT_NEAR(horizon_s("0.8"), 0.7, 0.1);
  EXPECT_GE(horizon_s("0.5"), 2.4);
}

TEST(FindHorizonTest, WhereNothingArrivesNoneIsLongEnough) {
  EXPECT_THROW(find_design(question(
                   "horizon",
                   {"controller.law=predictive", "actuator.policy=horizon", "channel.prr=0"}, 0.3)),
               UsageError);
}

TEST(FindTest, AQuestionThatDoesNotFitTheLawIsRefusedByKey) {
  const auto refusal = [](const std::string& what, const Settings& set) -> std::string {
    try {
      find_design(question(what, set, 0.1));
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal("tau", noisy("tracking")),
            "--find tau: controller.law = \"tracking\" must be \"pid\"");
  EXPECT_EQ(refusal("gains", noisy("pid")),
            "--find gains: controller.law = \"pid\" must be \"tracking\"");
  EXPECT_NE(refusal("horizon", noisy("tracking")).find("actuator.policy = \"hold\""),
            std::string::npos);
  EXPECT_NE(
      refusal("rate", {"controller.law=mpc", "actuator.policy=horizon"}).find("controller.law"),
      std::string::npos);
}

}  // namespace
}  // namespace tether
