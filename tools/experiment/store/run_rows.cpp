#include "tools/experiment/store/run_rows.hpp"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <set>

#include "common/base/fnv1a.hpp"
#include "tools/runs/metric.hpp"

namespace tether {

MetricColumns metric_columns_of(const Database& database) {
  std::set<std::string> columns;
  Statement all(database, "SELECT name FROM pragma_table_info('runs')");
  while (all.step()) columns.insert(all.text(0));
  MetricColumns found;
  for (const std::string& name : metric_names()) found.push_back(columns.contains(name));
  return found;
}

std::string missing_metrics(const MetricColumns& has_metric) {
  std::string names;
  for (std::size_t i = 0; i < has_metric.size(); ++i) {
    if (!has_metric[i]) names += (names.empty() ? "" : ", ") + metrics()[i].name;
  }
  return names;
}

std::string selected_metrics(const MetricColumns& has_metric) {
  std::string columns;
  for (std::size_t i = 0; i < has_metric.size(); ++i) {
    columns += has_metric[i] ? ", " + metrics()[i].name : ", NULL";
  }
  return columns;
}

RowSum& RowSum::add(std::string_view text) {
  bytes_ += fmt::format("{}:", text.size());
  bytes_ += text;
  return *this;
}

RowSum& RowSum::add(std::span<const std::uint8_t> bytes) {
  return add(std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

RowSum& RowSum::add(std::int64_t value) { return add(std::string_view(fmt::format("{}", value))); }

std::int64_t RowSum::value() const { return std::bit_cast<std::int64_t>(fnv1a(bytes_)); }

std::int64_t sum_of(const StoredRun& run, const MetricColumns& has_metric) {
  RowSum sum;
  sum.add(static_cast<std::int64_t>(run.arm)).add(static_cast<std::int64_t>(run.seed));
  sum.add(run.result.failure);
  if (!run.result.failure.empty()) return sum.value();  // its metrics are not stored
  for (std::size_t i = 0; i < has_metric.size(); ++i) {
    if (!has_metric[i]) continue;
    const double metric = run.result.metrics[i];
    // SQLite keeps no NaN, and zero without its sign.
    sum.add(std::isnan(metric) ? std::string("none") : fmt::format("{}", metric + 0.0));
  }
  return sum.value();
}

}  // namespace tether
