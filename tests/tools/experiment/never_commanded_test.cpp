#include "tools/experiment/sweep/never_commanded.hpp"

#include <cmath>

#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/experiment/store.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string paper(const std::vector<std::string>& overrides = {}) {
  return to_toml(load_scenario(in_source("/scenarios/paper.toml"), overrides));
}

TEST(NeverCommanded, AVehicleOfThePaperAtPrr01IsSoInSlightlyMoreThanHalfOfTheRuns) {
  const auto p = never_commanded_probability(paper({"channel.prr=0.1"}), 63);
  ASSERT_TRUE(p.has_value());
  EXPECT_NEAR(*p, 0.531, 0.0005);  // 0.99^63
  EXPECT_EQ(never_commanded_probability(paper(), 63), 0.0);
}

TEST(NeverCommanded, EachDirectionCountsWithItsOwnRatio) {
  const auto p =
      never_commanded_probability(paper({"channel.uplink.prr=0.5", "channel.downlink.prr=0.2"}), 2);
  ASSERT_TRUE(p.has_value());
  EXPECT_DOUBLE_EQ(*p, 0.81);
}

TEST(NeverCommanded, IsNotKnownWhereThatFormulaDoesNotHold) {
  for (const char* other :
       {"controller.trigger=timer", "channel.delay_ms=100", "channel.downlink.model=markov",
        "channel.uplink.loss=0.1", "channel.uplink.duplicate.probability=0.1"}) {
    EXPECT_EQ(never_commanded_probability(paper({other}), 63), std::nullopt) << other;
  }
}

/// Runs of the paper's scenario at PRR 0.1, with counters as they come.
class ByCommand : public Store {
 protected:
  static StoredRun run(std::uint64_t seed, double epsilon_m, double commands, double arrived) {
    StoredRun made{0, seed, result(epsilon_m)};
    const auto set = [&made](const char* metric, double value) {
      made.result.metrics[metric_number(metric).value()] = value;
    };
    set("uplink_sent", 63.0);
    set("uplink_lost", 63.0 - commands);
    set("downlink_sent", commands);
    set("downlink_lost", commands - arrived);
    return made;
  }
  RunStore store_of(const std::vector<StoredRun>& runs,
                    const std::vector<std::string>& overrides = {"channel.prr=0.1"}) {
    Experiment e;
    e.name = "by_command";
    e.arms = {Arm{{}, load_scenario(in_source("/scenarios/paper.toml"), overrides)}};
    for (const StoredRun& run : runs) e.seeds.push_back(run.seed);
    RunStore store = begin(e);
    store.add(runs);
    return store;
  }
};

TEST_F(ByCommand, RunsAreWeighedByTheChanceAndNotByTheirNumber) {
  const RunStore store = store_of({run(1, 15.0, 4.0, 0.0),
                                   run(2, 20.0, 9.0, 1.0),
                                   run(3, 24.0, 6.0, 2.0),
                                   run(4, 15.0, 0.0, 0.0),
                                   {0, 5, failure("why")}});
  const CommandedRuns runs = by_command(store).at(0);
  EXPECT_EQ(runs.runs, 4U);
  EXPECT_EQ(runs.never, 2U);
  const double p = runs.probability.value();
  EXPECT_DOUBLE_EQ(runs.epsilon_m.mean, 15.0 * p + 22.0 * (1.0 - p));
  std::string csv;
  export_stratified(store, [&csv](const std::string& text) { csv += text; });
  EXPECT_THAT(csv, StartsWith("arm,runs,never,never_expected,epsilon_m,"));
  EXPECT_THAT(csv, HasSubstr("\n0,4,2,2.12362,18.5,"));
  EXPECT_THAT(csv, HasSubstr(",18.2837,"));
}

TEST_F(ByCommand, PosesThatAreNotAnsweredLeaveTheChanceUnknown) {
  auto unanswered = run(2, 20.0, 9.0, 1.0);
  unanswered.result.metrics[metric_number("uplink_lost").value()] -= 1.0;
  const RunStore store = store_of({run(1, 15.0, 4.0, 0.0), unanswered});
  EXPECT_EQ(by_command(store).at(0).probability, std::nullopt);
  EXPECT_TRUE(std::isnan(by_command(store).at(0).epsilon_m.mean));
}

TEST(NeverCommandedRuns, AreAsManyAsChanceGivesAndAllEqual) {
  constexpr std::uint64_t kSeeds = 100;
  std::size_t never = 0;
  double epsilon_m = 0.0;
  Scenario scenario = load_scenario(in_source("/scenarios/paper.toml"),
                                    {"channel.prr=0.1", "vehicle.plant=kinematic"});
  const auto number = [](const char* name) { return metric_number(name).value(); };
  for (std::uint64_t seed = 2001; seed < 2001 + kSeeds; ++seed) {
    scenario.get<RunSettings>().seed = seed;
    const auto m = run_once(scenario, 0.0).metrics;
    if (m[number("downlink_sent")] != m[number("downlink_lost")]) continue;
    if (never++ == 0) epsilon_m = m[number("epsilon_m")];
    EXPECT_EQ(m[number("epsilon_m")], epsilon_m) << seed;
  }
  // 0.531 of 100, with a standard deviation of sqrt(100 · 0.531 · 0.469) = 5.0.
  EXPECT_NEAR(static_cast<double>(never), 53.1, 3.0 * 5.0);
}

}  // namespace
}  // namespace tether
