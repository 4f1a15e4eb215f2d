#include "tools/experiment/risk.hpp"

#include <algorithm>
#include <cmath>

#include "common/random.hpp"

namespace tether {
namespace {

constexpr float kAhead_s = 10.0F;

double mean_error_ahead(const std::vector<TrajectoryPoint>& rows, std::size_t from) {
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = from; i < rows.size() && rows[i].t_s < rows[from].t_s + kAhead_s; ++i) {
    sum += static_cast<double>(rows[i].error_m);
    ++count;
  }
  return sum / static_cast<double>(count);
}

bool is_bad(const TrajectoryPoint& row) {
  return std::max(row.uplink_state, row.downlink_state) > 0.5F;
}

/// What one run adds to the mean of each third.
struct Thirds {
  std::array<double, 3> sum{}, count{};

  void add(const Thirds& other) {
    for (std::size_t i = 0; i < 3; ++i) {
      sum[i] += other.sum[i];
      count[i] += other.count[i];
    }
  }
  double mean(std::size_t i) const { return sum[i] / count[i]; }
};

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
          if (!is_bad(row)) continue;
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

RiskFall risk_fall(const RunStore& store, RiskDefinition definition) {
  std::vector<Thirds> runs;
  store.for_each(
      [&](const StoredRun& run) {
        const auto& rows = run.result.trajectory;
        Thirds thirds;
        for (std::size_t i = 0; i < rows.size(); ++i) {
          if (!is_bad(rows[i])) continue;
          thirds.sum[3 * i / rows.size()] += risk(run.result, i, definition);
          ++thirds.count[3 * i / rows.size()];
        }
        if (!rows.empty()) runs.push_back(thirds);
      },
      true);
  RiskFall result;
  result.runs = runs.size();
  Thirds all;
  for (const Thirds& run : runs) all.add(run);
  for (std::size_t i = 0; i < 3; ++i) result.thirds[i] = all.mean(i);
  RandomEngine random = random_stream(kBootstrapSeed, "risk");
  std::array<std::vector<double>, 2> falls;
  for (int resample = 0; resample < kResamples; ++resample) {
    Thirds sample;
    for (std::size_t i = 0; i < runs.size(); ++i) {
      sample.add(
          runs[static_cast<std::size_t>(uniform_01(random) * static_cast<double>(runs.size()))]);
    }
    for (const std::size_t i : {1U, 2U}) {
      const double fall = sample.mean(0) - sample.mean(i);
      if (std::isfinite(fall)) falls[i - 1].push_back(fall);
    }
  }
  for (const std::size_t i : {0U, 1U}) {
    if (falls[i].size() < kResamples / 2) continue;
    std::sort(falls[i].begin(), falls[i].end());
    result.fall[i] = {quantile(falls[i], 0.5 * (1.0 - kConfidence)),
                      quantile(falls[i], 0.5 * (1.0 + kConfidence))};
  }
  return result;
}

}  // namespace tether
