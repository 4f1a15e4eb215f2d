#include <benchmark/benchmark.h>

#include <string>
#include <utility>
#include <vector>

#include "bench/bare_ode.hpp"
#include "bench/smoke.hpp"
#include "bench/timing.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/run_observer.hpp"

// A whole closed-loop run without file output, against its floor: bare ODE stepping of the
// identical world with the identical servo targets. Both are timed in turn, A B A B …, so that the
// ratio holds while the machine's speed drifts. The kinematic plant's whole run is compared with
// ODE's in the same way, and so are tyres that slip with rigid ones.

namespace tether {
namespace {

using bench::median;
using bench::record_servo_targets;
using bench::seconds_of;

Scenario paper(const std::vector<std::string>& overrides) {
  return load_scenario(in_source("/scenarios/paper.toml"), overrides);
}

void run_loop(const Scenario& scenario) {
  ClosedLoop closed_loop(scenario);
  const FleetObserver observer(closed_loop.members(), closed_loop.loop(), closed_loop.bus());
  closed_loop.run();
  benchmark::DoNotOptimize(closed_loop.sim().metrics().epsilon_m());
}

Scenario shipped(const std::string& name) {
  return load_scenario(in_source("/scenarios/") + name + ".toml", {});
}

void compare_with_bare_ode(benchmark::State& state, const Scenario& scenario) {
  const std::vector<WheelSpeeds> targets = record_servo_targets(scenario);
  const auto bare = [&] { bench::step_bare_ode(scenario, targets); };
  const auto loop = [&] { run_loop(scenario); };

  std::vector<double> bare_s, loop_s, ratio;
  for (auto unused : state) {
    (void)unused;
    bare_s.push_back(seconds_of(bare));
    loop_s.push_back(seconds_of(loop));
    ratio.push_back(loop_s.back() / bare_s.back());
    state.SetIterationTime(loop_s.back());
  }
  state.counters["bare_ode_us_per_step"] =
      median(bare_s) * 1e6 / static_cast<double>(targets.size());
  state.counters["loop_over_bare_ode"] = median(ratio);
  state.counters["real_time_factor"] = scenario.get<RunSettings>().duration_s / median(loop_s);
}

void whole_run(benchmark::State& state, const std::vector<std::string>& overrides) {
  compare_with_bare_ode(state, paper(overrides));
}

/// Cost of a vehicle of a fleet of 100, relative to a single one: side by side, 20 poses a second.
void fleet_of_100(benchmark::State& state, const std::string& plant) {
  const std::vector<std::string> common{"vehicle.plant=" + plant, "sensor.rate_hz=20",
                                        "world.half_extent_m=500", "run.duration_s=20"};
  auto many = common;
  many.insert(many.end(), {"fleet.count=100", "fleet.phases=none", "fleet.offset_y_m=9",
                           "fleet.columns=1", "path.offset_y_m=-450"});
  const Scenario one = paper(common), fleet = paper(many);
  std::vector<double> ratio, fleet_s;
  for (auto unused : state) {
    (void)unused;
    fleet_s.push_back(seconds_of([&] { run_loop(fleet); }));
    ratio.push_back(fleet_s.back() / seconds_of([&] {
                      for (int i = 0; i < 100; ++i) run_loop(one);
                    }));
    state.SetIterationTime(fleet_s.back());
  }
  state.counters["vehicle_over_one_alone"] = median(ratio);
  state.counters["real_time_factor"] = 20.0 / median(fleet_s);
}
BENCHMARK_CAPTURE(fleet_of_100, kinematic, std::string("kinematic"))
    ->UseManualTime()
    ->Iterations(bench::rounds(15))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(fleet_of_100, ode, std::string("ode"))
    ->UseManualTime()
    ->Iterations(bench::rounds(2))
    ->Unit(benchmark::kMillisecond);

BENCHMARK_CAPTURE(whole_run, paper_1_Hz, std::vector<std::string>{})
    ->UseManualTime()
    ->Iterations(bench::rounds(25))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_run, pose_and_command_20_Hz, std::vector<std::string>{"sensor.rate_hz=20"})
    ->UseManualTime()
    ->Iterations(bench::rounds(25))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_run, at_the_walls_prr_0_1, std::vector<std::string>{"channel.prr=0.1"})
    ->UseManualTime()
    ->Iterations(bench::rounds(25))
    ->Unit(benchmark::kMillisecond);

void agv_run(benchmark::State& state, const std::string& name) {
  compare_with_bare_ode(state, shipped(name));
}

BENCHMARK_CAPTURE(agv_run, agv_200kg, std::string("agv_200kg"))
    ->UseManualTime()
    ->Iterations(bench::rounds(9))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(agv_run, agv_1000kg, std::string("agv_1000kg"))
    ->UseManualTime()
    ->Iterations(bench::rounds(9))
    ->Unit(benchmark::kMillisecond);

/// ODE alone on brush tyres, against rigid ones with the same targets: solved as rolling first, as
/// the plant does, and with all limits at every step.
void brush_tyres(benchmark::State& state, const std::vector<std::string>& overrides) {
  const Scenario rigid = paper(overrides);
  Scenario brush = rigid;
  brush.get<VehicleSettings>().tyre = VehicleConfig::Tyre::brush;
  const std::vector<WheelSpeeds> targets = record_servo_targets(rigid);
  std::vector<double> rigid_s, limited_s, brush_s, ratio, limited_ratio;
  for (auto unused : state) {
    (void)unused;
    rigid_s.push_back(seconds_of([&] { bench::step_bare_ode(rigid, targets); }));
    limited_s.push_back(seconds_of([&] { bench::step_bare_ode(rigid, targets, true); }));
    brush_s.push_back(seconds_of([&] { bench::step_bare_ode(brush, targets); }));
    ratio.push_back(brush_s.back() / rigid_s.back());
    limited_ratio.push_back(brush_s.back() / limited_s.back());
    state.SetIterationTime(brush_s.back());
  }
  const auto us_per_step = [&](std::vector<double> s) {
    return median(std::move(s)) * 1e6 / static_cast<double>(targets.size());
  };
  state.counters["rigid_us_per_step"] = us_per_step(rigid_s);
  state.counters["limited_us_per_step"] = us_per_step(limited_s);
  state.counters["brush_us_per_step"] = us_per_step(brush_s);
  state.counters["brush_over_rigid"] = median(ratio);
  state.counters["brush_over_limited"] = median(limited_ratio);
}

BENCHMARK_CAPTURE(brush_tyres, paper_1_Hz, std::vector<std::string>{})
    ->UseManualTime()
    ->Iterations(bench::rounds(25))
    ->Unit(benchmark::kMillisecond);

void kinematic_run(benchmark::State& state, std::vector<std::string> overrides) {
  const Scenario ode = paper(overrides);
  overrides.emplace_back("vehicle.plant=kinematic");
  const Scenario kinematic = paper(overrides);

  std::vector<double> ode_s, kinematic_s, ratio;
  for (auto unused : state) {
    (void)unused;
    ode_s.push_back(seconds_of([&] { run_loop(ode); }));
    kinematic_s.push_back(seconds_of([&] { run_loop(kinematic); }));
    ratio.push_back(ode_s.back() / kinematic_s.back());
    state.SetIterationTime(kinematic_s.back());
  }
  state.counters["ode_loop_ms"] = median(ode_s) * 1e3;
  state.counters["speedup_over_ode"] = median(ratio);
  state.counters["real_time_factor"] =
      kinematic.get<RunSettings>().duration_s / median(kinematic_s);
}

BENCHMARK_CAPTURE(kinematic_run, paper_1_Hz, std::vector<std::string>{})
    ->UseManualTime()
    ->Iterations(bench::rounds(25))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(kinematic_run, at_the_walls_prr_0_1, std::vector<std::string>{"channel.prr=0.1"})
    ->UseManualTime()
    ->Iterations(bench::rounds(25))
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace tether
