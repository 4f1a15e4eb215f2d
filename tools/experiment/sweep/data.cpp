#include "tools/experiment/sweep/data.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "common/base/csv_table.hpp"
#include "tools/runs/metric.hpp"

namespace tether {

namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

bool is_same(double a, double b) { return std::abs(a - b) <= 1e-9; }

}  // namespace

SweepData::SweepData(const RunStore& store, const std::string& metric) : metric_(metric) {
  const MetricExpression measure(metric);
  const std::size_t lost = metric_number("lost").value();
  const std::size_t returned = metric_number("return_s").value();
  const std::size_t away = metric_number("away_s").value();
  const auto stored = store.arms();
  for (const auto& arm : stored) arms_.push_back({arm.settings, {}, {}, {}, {}});
  struct Columns {
    std::vector<double> lost, returned, away;
  };
  std::vector<Columns> columns(stored.size());
  store.for_each([&](const StoredRun& run) {
    const auto& values = run.result.metrics;
    const bool has_failed = !run.result.failure.empty();
    arms_.at(run.arm).runs.push_back({run.seed, has_failed ? kUnknown : measure.of(values)});
    columns[run.arm].lost.push_back(has_failed ? kUnknown : values[lost]);
    columns[run.arm].returned.push_back(has_failed ? kUnknown : values[returned]);
    columns[run.arm].away.push_back(has_failed ? kUnknown : values[away]);
  });
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    ArmData& arm = arms_[i];
    const std::vector<double> values = values_of(arm.runs);
    arm.summary = summarize(values, kConfidence, kBootstrapSeed);
    arm.survival = survival_of(values, columns[i].lost, kConfidence, kBootstrapSeed);
    arm.returns = returns_of(columns[i].returned, columns[i].away, kConfidence, kBootstrapSeed);
    arm.has_two_humps = measure.is_error() && arm.survival.lost.count > 0;
    for (std::size_t run = 0; run < arm.runs.size(); ++run) {
      if (columns[i].lost[run] <= 0.5) arm.survivors.push_back(arm.runs[run]);
    }
    if (metric == "lost") arm.summary.mean_interval = arm.survival.lost.interval;
    if (measure.is_share()) {
      const auto known = std::count_if(values.begin(), values.end(),
                                       [](double value) { return !std::isnan(value); });
      const auto count =
          std::count_if(values.begin(), values.end(), [](double value) { return value > 0.5; });
      arm.summary.mean_interval =
          share_of(static_cast<std::size_t>(count), static_cast<std::size_t>(known), kConfidence)
              .interval;
    }
  }
}

std::string SweepData::text(std::size_t arm, const std::string& key) const {
  for (const KeyValue& setting : arms_[arm].settings) {
    if (setting.key == key) return setting.plain();
  }
  return "";
}

double SweepData::number(std::size_t arm, const std::string& key) const {
  return finite_number(text(arm, key));
}

std::optional<std::size_t> SweepData::find(
    const std::vector<std::pair<std::string, double>>& values) const {
  for (std::size_t arm = 0; arm < arms_.size(); ++arm) {
    const bool fits = std::all_of(values.begin(), values.end(), [&](const auto& value) {
      return is_same(number(arm, value.first), value.second);
    });
    if (fits) return arm;
  }
  return std::nullopt;
}

std::vector<std::size_t> SweepData::where(const std::string& key, double value) const {
  std::vector<std::size_t> found;
  for (std::size_t arm = 0; arm < arms_.size(); ++arm) {
    if (is_same(number(arm, key), value)) found.push_back(arm);
  }
  return found;
}

std::vector<double> SweepData::values(const std::string& key) const {
  std::set<double> values;
  for (std::size_t arm = 0; arm < arms_.size(); ++arm) {
    if (const double x = number(arm, key); std::isfinite(x)) values.insert(x);
  }
  return {values.begin(), values.end()};
}

std::vector<double> values_of(const std::vector<SeededValue>& runs) {
  std::vector<double> values;
  for (const SeededValue& run : runs) values.push_back(run.value);
  return values;
}

std::string interval_text(const Interval& interval) {
  return fmt::format("[{:.4g}, {:.4g}]", interval.low, interval.high);
}

std::string share_text(const Share& share) {
  if (share.n == 0) return "-";
  return fmt::format("{}/{} [{:.3g}, {:.3g}] %", share.count, share.n, 100.0 * share.interval.low,
                     100.0 * share.interval.high);
}

std::string mean_text(const Summary& summary) {
  if (summary.n == 0) return "-";
  if (!std::isfinite(summary.mean_interval.low)) return fmt::format("{:.4g}", summary.mean);
  return fmt::format("{:.4g} {}", summary.mean, interval_text(summary.mean_interval));
}

}  // namespace tether
