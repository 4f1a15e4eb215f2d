#include "tools/margin/straight_trial.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "margin/loop/straight_loop.hpp"
#include "netem/channel/change.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tools/loop/closed_loop.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {
namespace {

constexpr double kNoise = 1e-6;
constexpr double kFar_m = 0.01;  // where limits may begin to play a part
constexpr double kBeside_m = 1e-3;
constexpr double kSettling_s = 2.0;
constexpr double kSettlingPeriods = 50.0;

/// When the path has its full speed.
double full_speed_s(const ReferencePath& path, double v_mps) {
  double t_s = 0.0;
  while (path.at(t_s).v_mps < v_mps * (1.0 - 1e-9)) t_s += 0.05;
  return t_s;
}

/// A scenario for trials, and what of its runs counts.
struct Layout {
  Scenario scenario;
  double period_s, from_s, turn_m;
  PathPoint start;

  Layout(const Scenario& given, double noise, double beside_m, double periods) : scenario(given) {
    const StraightLoop loop(given);
    const auto path = make_path(given.get<PathSettings>());
    start = path->at(0.0);
    period_s = loop.timing.period_s;
    turn_m = loop.v_mps / loop.steering.crossover_radps();  // of a radian, as it swings
    from_s = full_speed_s(*path, loop.v_mps) + kSettling_s + kSettlingPeriods * period_s;
    auto& vehicle = scenario.get<VehicleSettings>();
    vehicle.start_x_m = start.x_m - beside_m * std::sin(start.yaw_rad);
    vehicle.start_y_m = start.y_m + beside_m * std::cos(start.yaw_rad);
    vehicle.start_yaw_rad = start.yaw_rad;
    vehicle.start_error_m = vehicle.start_error_rad = 0.0;
    scenario.get<SensorSettings>().position_noise_m = noise;
    scenario.get<SensorSettings>().yaw_noise_rad = noise;
    auto& run = scenario.get<RunSettings>();
    run.duration_s = from_s + periods * period_s;
    run.truth_rate_hz = 1.0 / period_s;
    run.report_period_s = run.duration_s;
  }

  double log_m(const TrajectoryRow& row) const {
    const double across_m = std::cos(start.yaw_rad) * (row.y_m - start.y_m) -
                            std::sin(start.yaw_rad) * (row.x_m - start.x_m);
    return std::log(std::hypot(across_m, turn_m * wrap_angle(row.yaw_rad - start.yaw_rad)));
  }
};

/// The logarithms of a run's deviations, one a period.
std::vector<double> run_one(const Layout& layout, std::uint64_t seed) {
  Scenario scenario = layout.scenario;
  scenario.get<RunSettings>().seed = seed;
  ClosedLoop loop(scenario);
  const RunObserver observer(loop.members().front(), loop.loop(), loop.bus());
  loop.run();
  std::vector<double> logs;
  for (const TrajectoryRow& row : observer.trajectory()) {
    if (row.t_s >= layout.from_s) logs.push_back(layout.log_m(row));
  }
  return logs;
}

}  // namespace

double Tail::exponent(std::size_t without) const {
  std::vector<double> all;
  for (std::size_t i = 0; i < logs.size(); ++i) {
    if (i != without) all.insert(all.end(), logs[i].begin(), logs[i].end());
  }
  constexpr double kTop = 0.01;
  const auto top = static_cast<std::ptrdiff_t>(kTop * static_cast<double>(all.size()));
  const auto first = all.end() - top;
  std::nth_element(all.begin(), first - 1, all.end());
  const double least = *(first - 1);
  if (least > std::log(kFar_m)) {
    const auto far =
        std::count_if(all.begin(), all.end(), [](double x) { return x > std::log(kFar_m); });
    const double share = static_cast<double>(far) / static_cast<double>(all.size());
    return -std::log(share) / std::log(kFar_m / kNoise);
  }
  double sum = 0.0;
  for (auto it = first; it != all.end(); ++it) sum += *it - least;
  return static_cast<double>(top) / sum;
}

std::string why_no_trial(const Scenario& scenario) {
  const StraightLoop loop(scenario);
  if (loop.v_mps - loop.least_mps > 1e-6) {
    return fmt::format(
        "the path's speed varies, from {:.2f} to {:.2f} m/s: there is no single critical value",
        loop.least_mps, loop.v_mps);
  }
  const auto path = make_path(scenario.get<PathSettings>());
  const double end_s = scenario.get<RunSettings>().duration_s;
  for (int i = 0; i <= 1000; ++i) {
    if (path->at(end_s * i / 1000).omega_radps != 0.0) return "the path has curves";
  }
  return "";
}

Tail simulated_tail(const Scenario& scenario, double more_loss, const StraightTrial& trial) {
  Layout layout(scenario, kNoise, 0.0, static_cast<double>(trial.periods));
  auto& channel = layout.scenario.get<ChannelSettings>();
  if (more_loss > 0.0)
    channel = change_channel(channel, {fmt::format("loss={}", more_loss)}).channel;
  std::vector<std::vector<double>> runs(trial.runs);
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < trial.runs; i = next++) {
      runs[i] = run_one(layout, trial.seed + i);
    }
  };
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 1; i < trial.jobs; ++i) threads.emplace_back(work);
    work();
  }
  Tail tail{std::vector<std::vector<double>>(StraightTrial::kGroups)};
  for (std::size_t i = 0; i < trial.runs; ++i) {
    auto& group = tail.logs[i % StraightTrial::kGroups];
    group.insert(group.end(), runs[i].begin(), runs[i].end());
  }
  return tail;
}

double simulated_growth(const Scenario& scenario) {
  const double period_s = StraightLoop(scenario).timing.period_s;
  const double periods = std::max(100.0, 10.0 / period_s);
  const std::vector<double> logs = run_one(Layout(scenario, 0.0, kBeside_m, periods), 1);
  // Two windows of a third of the time, to be rid of the swinging.
  const std::size_t third = logs.size() / 3;
  double first = 0.0, last = 0.0;
  for (std::size_t i = 0; i < third; ++i) {
    first += logs[i];
    last += logs[logs.size() - 1 - i];
  }
  return (last - first) / static_cast<double>(third * (logs.size() - third));
}

}  // namespace tether
