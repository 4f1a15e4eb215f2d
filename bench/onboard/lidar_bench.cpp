#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "bench/smoke.hpp"
#include "bench/timing.hpp"
#include "common/base/random.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/world/surroundings.hpp"
#include "sim/sensor/lidar_settings.hpp"
#include "sim/sensor/ray_caster.hpp"
#include "tests/support/ode_rays.hpp"
#include "tools/nodes/closed_loop.hpp"

// Rays in a hall of 60 m by 40 m, against ODE's ray geoms among the same shapes in its quadtree;
// and a run with a scanner of 541 beams at 15 Hz, against the same run without. CPU time, A B A B
// ….

namespace tether {
namespace {

using std::numbers::pi;

/// Twelve racks, boxes, pillars and people around a free middle of 20 m by 20 m.
Scenario hall(const std::vector<std::string>& overrides = {}) {
  std::vector<std::string> all{"world.half_extent_m=30", "path.kind=circle", "path.radius_m=7"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  Scenario scenario = parse_scenario("", "hall", all);
  auto& obstacles = scenario.get<Surroundings>().obstacles;
  for (const double side : {-1.0, 1.0}) {
    obstacles.push_back({.kind = Obstacle::Kind::wall,
                         .pose = {0, side * 20.1, 0},
                         .length_m = 60,
                         .width_m = 0.2});
    for (const double y_m : {11.5, 15.0, 18.5}) {
      for (const double x_m : {-16.0, 16.0}) {
        obstacles.push_back({.kind = Obstacle::Kind::rack,
                             .pose = {x_m, side * y_m, 0},
                             .length_m = 20,
                             .width_m = 1.1,
                             .height_m = 4});
      }
    }
    for (int i = 0; i < 3; ++i) {
      obstacles.push_back({.kind = Obstacle::Kind::cylinder,
                           .pose = {side * 20, 5.0 * i - 8, 0},
                           .radius_m = 0.3,
                           .height_m = 1.8,
                           .to = {{side * 26, 8.0 - 5 * i}}});
    }
  }
  RandomEngine random = random_stream(1, "hall");
  for (int i = 0; i < 30; ++i) {
    const double x_m = (uniform_01(random) < 0.5 ? -1 : 1) * (12 + 16 * uniform_01(random));
    const double y_m = 18 * uniform_01(random) - 9;
    const bool pillar = i % 3 == 0;
    obstacles.push_back({.kind = pillar ? Obstacle::Kind::cylinder : Obstacle::Kind::box,
                         .pose = {x_m, y_m, pi * uniform_01(random)},
                         .length_m = 1.2,
                         .width_m = 0.8,
                         .radius_m = 0.2});
  }
  return scenario;
}

/// Turns of 541 beams over 270°, from places all over the hall, on the move.
std::vector<RayFan> turns(int count) {
  RandomEngine random = random_stream(2, "turns");
  std::vector<RayFan> fans(static_cast<std::size_t>(count));
  for (RayFan& fan : fans) {
    const double x_m = 58 * uniform_01(random) - 29, y_m = 38 * uniform_01(random) - 19;
    const double yaw_rad = 2 * pi * uniform_01(random);
    for (int i = 0; i < 541; ++i) {
      const double way_m = 1.5 * 0.05 * i / 541;
      fan.add({x_m + way_m * std::cos(yaw_rad), y_m + way_m * std::sin(yaw_rad)},
              yaw_rad + 1.5 * pi * (i / 540.0 - 0.5), 0.0);
    }
  }
  return fans;
}

void rays(benchmark::State& state, double height_m) {
  constexpr double kReach_m = 40.0;
  const std::vector<Shape> shapes = standing_shapes(hall());
  const RayCaster caster(shapes, height_m);
  std::vector<Shape> cut;
  for (const Shape& s : shapes) {
    if (s.clearance_m <= height_m && height_m <= s.height_m) cut.push_back(s);
  }
  test::OdeRays ode(cut, height_m);
  std::vector<RayFan> fans = turns(bench::is_smoke() ? 10 : 300);
  const double count = 541.0 * static_cast<double>(fans.size());
  std::vector<double> ours_s, ode_s, ratio;
  for (auto unused : state) {
    (void)unused;
    ours_s.push_back(bench::cpu_seconds_of([&] {
      for (RayFan& fan : fans) caster.cast(fan, kReach_m);
    }));
    double sum_m = 0.0;
    ode_s.push_back(bench::cpu_seconds_of([&] {
      for (const RayFan& fan : fans) {
        for (std::size_t i = 0; i < fan.size(); ++i) {
          sum_m += ode.cast(fan.x_m[i], fan.y_m[i], fan.dx[i], fan.dy[i], kReach_m).range_m;
        }
      }
    }));
    benchmark::DoNotOptimize(sum_m);
    ratio.push_back(ode_s.back() / ours_s.back());
    state.SetIterationTime(ours_s.back());
  }
  state.counters["shapes"] = static_cast<double>(cut.size());
  state.counters["Mrays_per_s"] = 1e-6 * count / bench::median(ours_s);
  state.counters["ode_Mrays_per_s"] = 1e-6 * count / bench::median(ode_s);
  state.counters["speedup_over_ode"] = bench::median(ratio);
}

BENCHMARK_CAPTURE(rays, at_2_m, 2.0)
    ->UseManualTime()
    ->Iterations(bench::rounds(15))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(rays, below_shelves, 0.2)
    ->UseManualTime()
    ->Iterations(bench::rounds(15))
    ->Unit(benchmark::kMillisecond);

void whole_run(benchmark::State& state, std::vector<std::string> overrides) {
  const std::string duration = bench::is_smoke() ? "run.duration_s=2" : "run.duration_s=60";
  overrides.push_back(duration);
  const Scenario without = hall({duration});
  const Scenario with = hall(overrides);
  const auto run = [](const Scenario& scenario) {
    ClosedLoop loop(scenario);
    loop.run();
  };
  std::vector<double> with_s, without_s, ratio;
  for (auto unused : state) {
    (void)unused;
    without_s.push_back(bench::cpu_seconds_of([&] { run(without); }));
    with_s.push_back(bench::cpu_seconds_of([&] { run(with); }));
    ratio.push_back(with_s.back() / without_s.back());
    state.SetIterationTime(with_s.back());
  }
  const double duration_s = with.get<RunSettings>().duration_s;
  state.counters["with_over_without"] = bench::median(ratio);
  state.counters["real_time_factor"] = duration_s / bench::median(with_s);
  state.counters["real_time_factor_without"] = duration_s / bench::median(without_s);
  const double scans = duration_s * with.get<LidarSettings>().rate_hz;
  state.counters["us_per_scan"] = 1e6 * (bench::median(with_s) - bench::median(without_s)) / scans;
}

BENCHMARK_CAPTURE(whole_run, beams_541_at_15_Hz,
                  std::vector<std::string>{"lidar.model=custom", "lidar.height_m=2"})
    ->UseManualTime()
    ->Iterations(bench::rounds(9))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_run, below_shelves,
                  std::vector<std::string>{"lidar.model=custom", "lidar.mount_x_m=1.6"})
    ->UseManualTime()
    ->Iterations(bench::rounds(9))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_run, mixed_pixels,
                  std::vector<std::string>{"lidar.model=custom", "lidar.height_m=2",
                                           "lidar.divergence_rad=0.005"})
    ->UseManualTime()
    ->Iterations(bench::rounds(9))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_run, sick_lms111_50_Hz,
                  std::vector<std::string>{"lidar.model=sick_lms111", "lidar.height_m=2"})
    ->UseManualTime()
    ->Iterations(bench::rounds(5))
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace tether
