#include "tools/margin/settled_error.hpp"

#include <cmath>
#include <stdexcept>

#include "common/scenario/run_settings.hpp"
#include "netem/statistics/estimate.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/margin/parallel.hpp"
#include "tools/runs/metric.hpp"

namespace tether {

namespace {

std::vector<RunResult> run_seeds(const Scenario& scenario, std::size_t seeds, std::size_t jobs) {
  std::vector<RunResult> results(seeds);
  for_each_index(seeds, jobs, [&](std::size_t i) {
    Scenario one = scenario;
    one.get<RunSettings>().seed = i + 1;
    results[i] = run_once(one, 0.0);
  });
  for (const RunResult& result : results) {
    if (!result.failure.empty()) throw std::runtime_error("a run failed: " + result.failure);
  }
  return results;
}

}  // namespace

FirstExcursion first_excursion_of_runs(const Scenario& scenario, std::size_t seeds,
                                       std::size_t jobs) {
  Scenario at_once = scenario;
  auto& run = at_once.get<RunSettings>();
  run.lost_for_s = 0.0;
  const std::size_t lost = *metric_number("lost"), when = *metric_number("lost_from_s");
  FirstExcursion first;
  first.beyond_m = run.lost_beyond_m;
  for (const RunResult& result : run_seeds(at_once, seeds, jobs)) {
    const double driven_s = result.metrics[when] - kSurvivalSettling_s;
    if (driven_s <= 0.0) continue;
    first.driven_s += driven_s;
    first.excursions += result.metrics[lost] > 0.5 ? 1 : 0;
  }
  first.mean_s = mean_time_interval(static_cast<double>(first.excursions), first.driven_s, 0.95);
  return first;
}

SettledError settled_error(const Scenario& scenario, std::size_t seeds, std::size_t jobs) {
  const std::vector<RunResult> results = run_seeds(scenario, seeds, jobs);
  const std::size_t metric = *metric_number("settled_epsilon_m");
  double sum = 0.0, squares = 0.0;
  for (const RunResult& result : results) {
    sum += result.metrics[metric];
    squares += result.metrics[metric] * result.metrics[metric];
  }
  const auto n = static_cast<double>(seeds);
  const double mean = sum / n, variance = std::max(0.0, squares / n - mean * mean) / (n - 1.0);
  return {mean, student_quantile(0.95, n - 1.0) * std::sqrt(variance)};
}

}  // namespace tether
