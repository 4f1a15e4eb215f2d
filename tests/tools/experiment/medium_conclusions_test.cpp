#include <gtest/gtest.h>

#include "common/scenario/run_settings.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/runs/metric.hpp"

// Conclusions of docs/explanation/medium.md from experiments/medium_stations.toml, by its arms
// where all eight of its seeds agree, on the first two of them and for half as long.

namespace tether {
namespace {

class MediumConclusions : public ::testing::Test {
 protected:
  struct Run {
    double settled_epsilon_m;
    double poses;  ///< share that came up
  };
  /// Runs of each seed.
  static std::vector<Run> runs(const std::string& law, const std::string& vehicles) {
    const Experiment experiment = load_experiment(in_source("/experiments/medium_stations.toml"));
    const Selection selection{{"law", {law}}, {"vehicles", {vehicles}}};
    std::vector<Run> runs;
    for (std::size_t arm = 0; arm < experiment.arms.size(); ++arm) {
      if (!is_selected(selection, experiment.arms[arm].settings)) continue;
      for (std::size_t n = 0; n < 2; ++n) {
        Scenario scenario = experiment.arms[arm].scenario;
        scenario.get<RunSettings>().seed = experiment.seed(arm, n);
        scenario.get<RunSettings>().duration_s = 31.0;
        const RunResult result = run_once(scenario, 0.0);
        EXPECT_EQ(result.failure, "");
        runs.push_back({result.metrics[*metric_number("settled_epsilon_m")],
                        result.metrics[*metric_number("uplink_sent")]});
      }
    }
    EXPECT_EQ(runs.size(), 2U) << law << " at " << vehicles;
    return runs;
  }
};

TEST_F(MediumConclusions, AHundredVehiclesAt20HzShareAnAccessPointAnd250DoNot) {
  for (const std::string law : {"PID 20/20, DCF", "plans 20/20, DCF"}) {
    for (const Run& run : runs(law, "100")) EXPECT_LT(run.settled_epsilon_m, 0.1) << law;
    for (const Run& run : runs(law, "250")) EXPECT_GT(run.settled_epsilon_m, 0.1) << law;
  }
}

TEST_F(MediumConclusions, PlansFromAPoseASecondLetFarMoreVehiclesIn) {
  for (const Run& run : runs("plans 1/10, DCF", "250")) EXPECT_LT(run.settled_epsilon_m, 0.1);
}

TEST_F(MediumConclusions, VoicesShortWindowsCollideWhereAllAreVoice) {
  const std::vector<Run> dcf = runs("PID 20/20, DCF", "200");
  const std::vector<Run> voice = runs("PID 20/20, EDCA voice", "200");
  for (std::size_t n = 0; n < dcf.size(); ++n) EXPECT_LT(voice[n].poses, 0.5 * dcf[n].poses);
}

}  // namespace
}  // namespace tether
