#include "tools/margin/settled_error.hpp"

#include <cmath>
#include <stdexcept>

#include "common/scenario/run_settings.hpp"
#include "netem/statistics/estimate.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/margin/parallel.hpp"
#include "tools/runs/metric.hpp"

namespace tether {

SettledError settled_error(const Scenario& scenario, std::size_t seeds, std::size_t jobs) {
  std::vector<RunResult> results(seeds);
  for_each_index(seeds, jobs, [&](std::size_t i) {
    Scenario one = scenario;
    one.get<RunSettings>().seed = i + 1;
    results[i] = run_once(one, 0.0);
  });
  const std::size_t metric = *metric_number("settled_epsilon_m");
  double sum = 0.0, squares = 0.0;
  for (const RunResult& result : results) {
    if (!result.failure.empty()) throw std::runtime_error("a run failed: " + result.failure);
    sum += result.metrics[metric];
    squares += result.metrics[metric] * result.metrics[metric];
  }
  const auto n = static_cast<double>(seeds);
  const double mean = sum / n, variance = std::max(0.0, squares / n - mean * mean) / (n - 1.0);
  return {mean, student_quantile(0.95, n - 1.0) * std::sqrt(variance)};
}

}  // namespace tether
