#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <thread>
#include <vector>

#include "bench/bare_ode.hpp"
#include "bench/smoke.hpp"
#include "bench/timing.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/experiment/sweep/sweep.hpp"

// Sweeping on all cores against two floors that do the same physics steps: bare ODE stepping with
// the recorded servo targets, on as many threads and in turn; and single runs, one after the other,
// on one core.

namespace tether {
namespace {

using bench::cpu_seconds_of;
using bench::median;
using bench::seconds_of;

double resident_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

Experiment make_experiment(std::size_t seeds) {
  Experiment experiment;
  experiment.name = "bench";
  experiment.arms = {{{}, load_scenario(in_source("/scenarios/paper.toml"), {})}};
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) experiment.seeds.push_back(seed);
  return experiment;
}

void sweep(const Experiment& experiment, std::size_t jobs) {
  const auto file = std::filesystem::temp_directory_path() / "tether_sweep_bench.sqlite";
  for (const char* rest : {"", "-wal", "-shm"}) std::filesystem::remove(file.string() + rest);
  RunStore store = RunStore::begin(file, experiment, {});
  const SweepOptions options{jobs, [](const auto&) { return 0.0; }, nullptr, run_once};
  const std::atomic<bool> stop{false};
  run_sweep(experiment, {}, store, options, stop);
}

void paper_runs(benchmark::State& state) {
  const std::size_t cores = std::max(1U, std::thread::hardware_concurrency());
  const std::size_t each = bench::is_smoke() ? 2 : 10;  // runs a core
  const Experiment experiment = make_experiment(cores * each);
  const Scenario& scenario = experiment.arms.front().scenario;
  const auto targets = bench::record_servo_targets(scenario);
  const auto on_one_core = [&] {
    for (std::size_t run = 0; run < each; ++run) bench::step_bare_ode(scenario, targets);
  };
  const auto on_all_cores = [&] {
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < cores; ++i) threads.emplace_back(on_one_core);
    for (std::thread& thread : threads) thread.join();
  };
  std::vector<double> sweep_s, single_s, share, efficiency, of_bare;
  for (auto unused : state) {
    (void)unused;
    const double bare_single_s = seconds_of(on_one_core);
    double bare_s = 0.0;
    const double bare_cpu_s = cpu_seconds_of([&] { bare_s = seconds_of(on_all_cores); });
    of_bare.push_back(bare_single_s / bare_s);
    const double sweep_cpu_s =
        cpu_seconds_of([&] { sweep_s.push_back(seconds_of([&] { sweep(experiment, cores); })); });
    single_s.push_back(seconds_of([&] {
      for (std::size_t i = 0; i < each; ++i) run_once(scenario, 0.0);
    }));
    share.push_back(bare_cpu_s / sweep_cpu_s);
    efficiency.push_back(single_s.back() / sweep_s.back());
    state.SetIterationTime(sweep_s.back());
  }
  const auto runs = static_cast<double>(cores * each);
  state.counters["runs_per_s"] = runs / median(sweep_s);
  state.counters["single_per_s"] = static_cast<double>(each) / median(single_s);
  state.counters["parallel_efficiency"] = median(efficiency);
  state.counters["bare_efficiency"] = median(of_bare);
  state.counters["share_in_ode"] = median(share);
  state.counters["cores"] = static_cast<double>(cores);
}

BENCHMARK(paper_runs)->UseManualTime()->Iterations(bench::rounds(7))->Unit(benchmark::kMillisecond);

/// Kinematic, as they are faster: the highest memory use so far.
void memory(benchmark::State& state) {
  Experiment experiment = make_experiment(static_cast<std::size_t>(state.range(0)));
  experiment.arms.front().scenario.get<VehicleSettings>().plant = VehicleSettings::Plant::kinematic;
  for (auto unused : state) {
    (void)unused;
    state.SetIterationTime(seconds_of([&] { sweep(experiment, 2); }));
  }
  state.counters["resident_MB"] = resident_mb();
}

BENCHMARK(memory)
    ->ArgName("runs")
    ->Arg(100)
    ->Arg(bench::is_smoke() ? 200 : 10'000)
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace tether
