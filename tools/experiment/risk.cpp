#include "tools/experiment/risk.hpp"

#include <algorithm>

namespace tether {
namespace {

constexpr float kAhead_s = 10.0F;
constexpr std::uint64_t kBootstrapSeed = 1;

double mean_error_ahead(const std::vector<TrajectoryPoint>& rows, std::size_t from) {
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = from; i < rows.size() && rows[i].t_s < rows[from].t_s + kAhead_s; ++i) {
    sum += static_cast<double>(rows[i].error_m);
    ++count;
  }
  return sum / static_cast<double>(count);
}

double risk(const RunResult& run, std::size_t row, RiskDefinition definition) {
  switch (definition) {
    case RiskDefinition::whole_run:
      return run.metrics[0];
    case RiskDefinition::next_10_s:
      return mean_error_ahead(run.trajectory, row);
    case RiskDefinition::now:
      break;
  }
  return static_cast<double>(run.trajectory[row].error_m);
}

}  // namespace

std::vector<RiskPoint> risk_points(const RunStore& store, RiskDefinition definition) {
  std::vector<RiskPoint> points;
  std::vector<std::vector<double>> values;
  store.for_each(
      [&](const StoredRun& run) {
        const auto& rows = run.result.trajectory;
        for (std::size_t i = 0; i < rows.size(); ++i) {
          const TrajectoryPoint& row = rows[i];
          if (i == points.size()) {
            const auto d = [](float x) { return static_cast<double>(x); };
            points.push_back({d(row.t_s), d(row.x_ref_m), d(row.y_ref_m), 0.0, {}, 0});
            values.emplace_back();
          }
          if (std::max(row.uplink_state, row.downlink_state) < 0.5F) continue;
          values[i].push_back(risk(run.result, i, definition));
        }
      },
      true);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Summary summary = summarize(values[i], kConfidence, kBootstrapSeed);
    points[i].mean = summary.mean;
    points[i].interval = summary.mean_interval;
    points[i].n = summary.n;
  }
  return points;
}

}  // namespace tether
