#include "tools/experiment/report/risk.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "common/base/random.hpp"
#include "tools/experiment/statistics/random_index.hpp"

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

/// Parts of the path: its three thirds; then the part before its first sharp turn, and the part
/// after.
constexpr std::size_t kBeforeTurns = 3, kRest = 4, kParts = 5;

/// Contribution of one run to the mean of each part.
struct Sums {
  std::array<double, kParts> sum{}, count{};

  void add(const Sums& other) {
    for (std::size_t i = 0; i < kParts; ++i) {
      sum[i] += other.sum[i];
      count[i] += other.count[i];
    }
  }
  double mean(std::size_t part) const { return sum[part] / count[part]; }
  double fall(std::size_t from, std::size_t to) const { return mean(from) - mean(to); }
};

RiskPoint place_of(const TrajectoryPoint& row) {
  return {static_cast<double>(row.t_s),
          static_cast<double>(row.x_ref_m),
          static_cast<double>(row.y_ref_m),
          0.0,
          {},
          0};
}

/// Infinite if there is none.
double first_turn_s(const std::vector<TrajectoryPoint>& rows) {
  std::vector<RiskPoint> path;
  for (const TrajectoryPoint& row : rows) path.push_back(place_of(row));
  const auto turns = sharp_turns(path);
  return turns.empty() ? std::numeric_limits<double>::infinity() : turns.front().start_s;
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

std::vector<Sums> sums_of_runs(const RunStore& store, RiskDefinition definition) {
  std::vector<Sums> runs;
  std::optional<double> turn_s;
  store.for_each(
      [&](const StoredRun& run) {
        const auto& rows = run.result.trajectory;
        if (rows.empty()) return;
        if (!turn_s) turn_s = first_turn_s(rows);
        Sums sums;
        for (std::size_t i = 0; i < rows.size(); ++i) {
          if (!is_bad(rows[i])) continue;
          const double value = risk(run.result, i, definition);
          const bool is_before = static_cast<double>(rows[i].t_s) < *turn_s;
          for (const std::size_t part : {3 * i / rows.size(), is_before ? kBeforeTurns : kRest}) {
            sums.sum[part] += value;
            ++sums.count[part];
          }
        }
        runs.push_back(sums);
      },
      true);
  return runs;
}

/// The estimate of one quantity from its bootstrap samples, which are not finite where a part had
/// no run in B.
MeanEstimate estimate(double measured, std::vector<double> samples) {
  std::erase_if(samples, [](double value) { return !std::isfinite(value); });
  if (samples.size() < kResamples / 2) return {measured, {}};
  std::sort(samples.begin(), samples.end());
  return {
      measured,
      {quantile(samples, 0.5 * (1.0 - kConfidence)), quantile(samples, 0.5 * (1.0 + kConfidence))}};
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
            points.push_back(place_of(row));
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

std::string to_text(RiskDefinition definition) {
  switch (definition) {
    case RiskDefinition::whole_run:
      return "mean ε of the runs in B there";
    case RiskDefinition::next_10_s:
      return "mean error of the next 10 s when in B there";
    case RiskDefinition::now:
      break;
  }
  return "mean error when in B there";
}

RiskFall risk_fall(const RunStore& store, RiskDefinition definition) {
  const std::vector<Sums> runs = sums_of_runs(store, definition);
  Sums all;
  for (const Sums& run : runs) all.add(run);
  std::vector<Sums> samples(runs.empty() ? 0 : kResamples);
  RandomEngine random = random_stream(kBootstrapSeed, "risk");
  for (Sums& sample : samples) {
    for (std::size_t i = 0; i < runs.size(); ++i)
      sample.add(runs[random_index(random, runs.size())]);
  }
  const auto of = [&](auto quantity) {
    std::vector<double> values;
    for (const Sums& sample : samples) values.push_back(quantity(sample));
    return estimate(quantity(all), std::move(values));
  };
  const auto mean = [&of](std::size_t part) {
    return of([part](const Sums& sums) { return sums.mean(part); });
  };
  const auto fall = [&of](std::size_t from, std::size_t to) {
    return of([from, to](const Sums& sums) { return sums.fall(from, to); });
  };
  return {definition,         {mean(0), mean(1), mean(2)}, fall(0, 1), fall(0, 2),
          mean(kBeforeTurns), fall(kBeforeTurns, kRest),   runs.size()};
}

}  // namespace tether
