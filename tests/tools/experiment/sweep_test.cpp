#include "tools/experiment/sweep/sweep.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <mutex>
#include <new>
#include <thread>

#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/channel/settings.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/experiment/sweep/export.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/metric.hpp"
#include "tools/runs/run_observer.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

/// Smallest possible run.
Scenario short_scenario(double prr) {
  Scenario scenario;
  scenario.get<RunSettings>().duration_s = 3.0;
  scenario.get<ChannelSettings>().uplink.fixed.prr =
      scenario.get<ChannelSettings>().downlink.fixed.prr = prr;
  return scenario;
}

class Sweep : public ::testing::Test {
 protected:
  Sweep() {
    experiment_.name = "short";
    experiment_.keys = {"channel.prr"};
    for (const double prr : {1.0, 0.7, 0.4}) {
      experiment_.arms.push_back({{{"channel.prr", std::to_string(prr)}}, short_scenario(prr)});
    }
    experiment_.seeds = {1, 2, 3, 4};
    options_.run = run_once;
    options_.half_width = [](const std::vector<double>&) { return 0.0; };
  }

  RunStore begin(const std::string& name) {
    return RunStore::begin(folder_ / name, experiment_, {});
  }
  bool sweep(RunStore& store) {
    return run_sweep(experiment_, {}, store, options_, stop_).is_complete;
  }
  static std::string exported(const RunStore& store) {
    std::string text;
    export_runs(store, [&text](const std::string& more) { text += more; });
    return text;
  }

  test::Folder own_;
  const std::filesystem::path& folder_ = own_.path;
  Experiment experiment_;
  SweepOptions options_;
  std::atomic<bool> stop_{false};
};

TEST_F(Sweep, GivesTheSameBytesWithAnyNumberOfThreads) {
  std::string one_thread;
  for (const std::size_t jobs : {1U, 2U, 5U}) {
    options_.jobs = jobs;
    RunStore store = begin(std::to_string(jobs));
    EXPECT_TRUE(sweep(store));
    EXPECT_TRUE(store.is_complete());
    EXPECT_EQ(store.size(), 12U);
    if (jobs == 1) one_thread = exported(store);
    EXPECT_EQ(exported(store), one_thread);
  }
}

TEST_F(Sweep, HasTheResultsOfSingleRuns) {
  experiment_.trajectory_period_s = 0.5;
  RunStore store = begin("runs");
  sweep(store);
  store.for_each([](const StoredRun& run) {
    if (run.arm != 1) return;
    Scenario scenario = short_scenario(0.7);
    scenario.get<RunSettings>().seed = run.seed;
    ClosedLoop loop(scenario);
    const RunObserver observer(scenario, loop.loop(), loop.bus());
    loop.run();
    const auto metric = [&run](const char* name) {
      return run.result.metrics.at(metric_number(name).value());
    };
    EXPECT_EQ(metric("epsilon_m"), observer.truth().epsilon_m);
    EXPECT_EQ(metric("max_error_m"), observer.truth().max_error_m);
    EXPECT_EQ(metric("settled_epsilon_m"), observer.truth().settled_epsilon_m);
    EXPECT_EQ(metric("lost"), 0.0);
    EXPECT_NEAR(metric("lost_from_s"), 3.0, 1e-9) << "not up to the run's end";
    EXPECT_EQ(metric("aoi_ms_mean"), observer.aoi_mean_s(kStart + std::chrono::seconds{3}) * 1e3);
    EXPECT_EQ(metric("uplink_lost"), static_cast<double>(observer.uplink().lost));
    EXPECT_EQ(metric("uplink_delay_ms_p99"), observer.uplink().delay_ms_p99);
    EXPECT_EQ(metric("downlink_delay_ms_max"), observer.downlink().delay_ms_max);
  });
  std::size_t rows = 0;
  store.for_each([&](const StoredRun& run) { rows = run.result.trajectory.size(); }, true);
  EXPECT_EQ(rows, 7U);  // 0, 0.5 … 3 s
}

TEST(RunSummaryText, SaysSinceWhenAVehicleIsLost) {
  Scenario scenario = short_scenario(0.0);  // it never gets a command
  scenario.get<RunSettings>().lost_beyond_m = 1.0;
  scenario.get<RunSettings>().lost_for_s = 0.5;
  ClosedLoop loop(scenario);
  const RunObserver observer(scenario, loop.loop(), loop.bus());
  loop.run();
  const auto text_after = [&](double sim_time_s) {
    return to_text(scenario, observer, {.sim_time_s = sim_time_s});
  };
  const std::string text = text_after(3.0);
  EXPECT_NE(text.find(fmt::format("LOST      from {:.1f} s on\n", observer.truth().lost_from_s)),
            std::string::npos)
      << text;
  EXPECT_EQ(text.find("settled"), std::string::npos) << "3 s are not yet settled";
  EXPECT_NE(text_after(11.0).find("settled   from 10 s on"), std::string::npos);
  EXPECT_NE(to_json(scenario, observer, {}).find("\"lost\": true"), std::string::npos);
  EXPECT_NEAR(observer.truth().lost_from_s + observer.truth().away_s, 3.0, 1e-9);
}

TEST(MetricTable, EachRowHasANameALabelAndANumberOfEachRun) {
  const RunResult result = run_once(short_scenario(1.0), 0.0);
  ASSERT_EQ(result.failure, "");
  ASSERT_EQ(result.metrics.size(), metrics().size());
  for (std::size_t i = 0; i < metrics().size(); ++i) {
    EXPECT_NE(metrics()[i].name, "");
    EXPECT_NE(metrics()[i].label, "") << metrics()[i].name;
    EXPECT_TRUE(std::isfinite(result.metrics[i])) << metrics()[i].name;
  }
}

TEST_F(Sweep, RecordsARunThatFailsAndGoesOn) {
  options_.run = [](const Scenario& scenario, double period_s, std::size_t) {
    if (scenario.get<RunSettings>().seed != 2) return run_once(scenario, period_s);
    RunResult failed;
    failed.failure = "no luck";
    return failed;
  };
  RunStore store = begin("runs");
  EXPECT_TRUE(sweep(store));
  EXPECT_EQ(store.size(), 12U);
  EXPECT_EQ(store.failures(), 3U);
  EXPECT_THAT(exported(store), ::testing::HasSubstr(",2,ode,no luck,"));
}

TEST_F(Sweep, ReportsAnImpossibleScenarioAsTheRunsFailure) {
  Scenario impossible = short_scenario(1.0);
  impossible.get<VehicleSettings>().track_m = -1.0;
  EXPECT_NE(run_once(impossible, 0.0).failure, "");
}

TEST_F(Sweep, StopsAfterTheRunsUnderWayAndGoesOnLater) {
  options_.jobs = 2;
  std::atomic<int> made{0};
  options_.run = [&](const Scenario& scenario, double period_s, std::size_t) {
    if (++made == 5) stop_ = true;
    return run_once(scenario, period_s);
  };
  RunStore store = begin("runs");
  EXPECT_FALSE(sweep(store));
  EXPECT_EQ(store.size(), static_cast<std::size_t>(made));  // none was thrown away
  EXPECT_LT(made, 12);
  EXPECT_FALSE(store.is_complete());
  stop_ = false;
  EXPECT_TRUE(sweep(store));
  EXPECT_EQ(made, 12);  // none was made twice
  RunStore undisturbed = begin("undisturbed");
  options_.run = run_once;
  sweep(undisturbed);
  EXPECT_EQ(exported(store), exported(undisturbed));
}

/// Runs of which those of seed 2 are killed, as often as `kills` says for each of them.
class KilledRuns {
 public:
  explicit KilledRuns(int kills) : kills_(kills) {}
  RunResult operator()(const Scenario& scenario, double period_s) {
    const std::lock_guard lock(mutex_);
    const double prr = scenario.get<ChannelSettings>().uplink.fixed.prr;
    RunResult killed;
    killed.failure = "controller was killed by signal 9";
    killed.is_to_be_repeated = true;
    if (scenario.get<RunSettings>().seed == 2 && tries_[prr]++ < kills_) return killed;
    return run_once(scenario, period_s);
  }

 private:
  int kills_;
  std::mutex mutex_;
  std::map<double, int> tries_;
};

TEST_F(Sweep, MakesARunThatWasKilledOnceMore) {
  KilledRuns runs(1);
  options_.jobs = 2;
  options_.run = [&](const Scenario& s, double period_s, std::size_t) { return runs(s, period_s); };
  RunStore store = begin("runs");
  EXPECT_TRUE(sweep(store));
  RunStore undisturbed = begin("undisturbed");
  options_.run = run_once;
  sweep(undisturbed);
  EXPECT_EQ(exported(store), exported(undisturbed));
}

TEST_F(Sweep, IsNotCompleteWhereARunWasKilledTwiceAndTriesItAgainLater) {
  KilledRuns runs(3);  // the first sweep twice, the second one once
  options_.jobs = 2;
  options_.run = [&](const Scenario& s, double period_s, std::size_t) { return runs(s, period_s); };
  RunStore store = begin("runs");
  const SweepEnd end = run_sweep(experiment_, {}, store, options_, stop_);
  EXPECT_FALSE(end.is_complete);
  ASSERT_EQ(end.missing.size(), 3U);
  EXPECT_EQ(end.missing[0].seed, 2U);
  EXPECT_EQ(end.missing[0].result.failure, "controller was killed by signal 9");
  EXPECT_FALSE(store.is_complete());
  EXPECT_EQ(store.size(), 9U);
  EXPECT_EQ(store.failures(), 0U);
  EXPECT_TRUE(sweep(store));
  EXPECT_TRUE(store.is_complete());
  EXPECT_EQ(store.size(), 12U);
}

TEST_F(Sweep, OfMemoryThatRanOutHasNoResult) {
  std::atomic<int> tries{0};
  experiment_.arms.resize(1);
  experiment_.seeds = {1};
  options_.run = [&](const Scenario&, double, std::size_t) {
    ++tries;
    return result_of([]() -> RunResult { throw std::bad_alloc(); });
  };
  RunStore store = begin("runs");
  EXPECT_FALSE(sweep(store));
  EXPECT_EQ(tries, 2);
  EXPECT_EQ(store.size(), 0U);
}

TEST_F(Sweep, ShowsHowFarItIs) {
  SweepProgress last;
  options_.show = [&last](const SweepProgress& p) {
    EXPECT_GE(p.ended, last.ended);
    last = p;
  };
  RunStore store = begin("runs");
  sweep(store);
  EXPECT_EQ(last.ended, 12U);
  EXPECT_EQ(last.known, 12U);
  EXPECT_EQ(last.made, 12U);
  EXPECT_EQ(last.failed, 0U);
}

TEST_F(Sweep, EndsWithTheStoresErrorIfItCannotStore) {
  RunStore store = begin("runs");
  Database(folder_ / "runs", Database::Mode::write).execute("DROP TABLE runs");
  EXPECT_THROW(sweep(store), std::runtime_error);
}

}  // namespace
}  // namespace tether
