#include "tools/margin/settled_error.hpp"

#include <atomic>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <stdexcept>
#include <thread>

#include "common/scenario/run_settings.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/runs/metric.hpp"

namespace tether {

SettledError settled_error(const Scenario& scenario, std::size_t seeds, std::size_t jobs) {
  std::vector<RunResult> results(seeds);
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < seeds; i = next++) {
      Scenario one = scenario;
      one.get<RunSettings>().seed = i + 1;
      results[i] = run_once(one, 0.0);
    }
  };
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 1; i < jobs; ++i) threads.emplace_back(work);
    work();
  }
  const std::size_t metric = *metric_number("settled_epsilon_m");
  double sum = 0.0, squares = 0.0;
  for (const RunResult& result : results) {
    if (!result.failure.empty()) throw std::runtime_error("a run failed: " + result.failure);
    sum += result.metrics[metric];
    squares += result.metrics[metric] * result.metrics[metric];
  }
  const auto n = static_cast<double>(seeds);
  const double mean = sum / n, variance = std::max(0.0, squares / n - mean * mean) / (n - 1.0);
  const double quantile = boost::math::quantile(boost::math::students_t(n - 1.0), 0.975);
  return {mean, quantile * std::sqrt(variance)};
}

}  // namespace tether
