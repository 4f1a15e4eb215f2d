#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/support/source_dir.hpp"
#include "tools/margin/straight_loop.hpp"
#include "tools/margin/verification.hpp"

namespace tether {
namespace {

Scenario straight(const std::vector<std::string>& more) {
  std::vector<std::string> set{"controller.law=tracking",
                               "vehicle.plant=kinematic",
                               "sensor.rate_hz=10",
                               "path.kind=line",
                               "path.length_m=200",
                               "path.speed_mps=1.5",
                               "path.max_acceleration_mps2=3",
                               "world.half_extent_m=500"};
  set.insert(set.end(), more.begin(), more.end());
  return load_scenario(in_source("/scenarios/paper.toml"), set);
}

TEST(LoopPopulationTest, WithoutLossesOneLoopShrinksAsItsEigenvalueSays) {
  const Scenario scenario = straight({"sensor.latency_ms=300"});
  const StraightLoop loop(scenario);
  const PopulationGrowth growth = whole_loop_growth(scenario, 0.0, {.periods = 100});
  const double predicted = std::log(loop.radius(loop.chain(), LoopPart::across));
  EXPECT_NEAR(growth.log_radius, predicted, 0.02 * std::abs(predicted));
}

TEST(LoopPopulationTest, TheSameSeedGrowsEquallyAndStaysSmallAndSteady) {
  const Scenario scenario =
      straight({"sensor.latency_ms=250", "channel.model=gilbert_elliott",
                "channel.gilbert_elliott.prr=0.9", "channel.gilbert_elliott.mean_burst=3"});
  const PopulationTrial trial{.loops = 10, .periods = 10, .seed = 3};
  const PopulationGrowth one = whole_loop_growth(scenario, 0.0, trial);
  EXPECT_EQ(one.log_radius, whole_loop_growth(scenario, 0.0, trial).log_radius);
  EXPECT_NE(one.log_radius,
            whole_loop_growth(scenario, 0.0, {.loops = 10, .periods = 10, .seed = 4}).log_radius);
  EXPECT_LT(one.largest_m, 1e-3);
  EXPECT_LT(one.speed_off, 1e-3) << "gains are in proportion to it";
}

TEST(LoopPopulationTest, APathWithCurvesOrOtherSpeedsIsNoTrial) {
  EXPECT_EQ(why_no_trial(straight({})), "");
  EXPECT_NE(
      why_no_trial(load_scenario(in_source("/scenarios/paper.toml"), {"controller.law=tracking"})),
      "");
}

}  // namespace
}  // namespace tether
