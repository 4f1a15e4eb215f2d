#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tools/experiment/store/database.hpp"
#include "tools/experiment/store/run_store.hpp"

namespace tether {

/// Which of metrics() a database has, in their order: those of older versions lack newer ones.
using MetricColumns = std::vector<bool>;
MetricColumns metric_columns_of(const Database& database);
/// The others' names: "lost, return_s".
std::string missing_metrics(const MetricColumns& has_metric);
/// ", epsilon_m, rmse_m, NULL…": all metrics, for SELECT.
std::string selected_metrics(const MetricColumns& has_metric);

/// Checksum of a row's fields, in the table's order: each with its length, so that none runs into
/// the next.
class RowSum {
 public:
  RowSum& add(std::string_view text);
  RowSum& add(std::span<const std::uint8_t> bytes);
  RowSum& add(std::int64_t value);
  /// SQLite's integers are signed.
  std::int64_t value() const;

 private:
  std::string bytes_;
};

/// Checksum of a run's row without its trajectory.
std::int64_t sum_of(const StoredRun& run, const MetricColumns& has_metric);

}  // namespace tether
