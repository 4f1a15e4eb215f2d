#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/statistics/comparison.hpp"
#include "tools/experiment/statistics/statistics.hpp"
#include "tools/experiment/statistics/survival.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// One metric of all runs of a sweep, in memory. The mean of `lost` is a share, with the interval
/// of a share.
class SweepData {
 public:
  struct ArmData {
    std::vector<KeyValue> settings;
    std::vector<SeededValue> runs;  ///< NaN: failed
    Summary summary;
    Survival survival;  ///< with the metric's survivors, where the database knows of losses
    Returns returns;

    /// The metric is an error, and some vehicle was lost: its law has two humps, and one mean of
    /// both is not to be shown alone.
    bool has_two_humps = false;
    /// The runs whose vehicles were not lost: what is to be compared where there are two humps.
    std::vector<SeededValue> survivors = {};
  };

  /// `metric`: one of metrics(), or an expression over them (metric_expression.hpp).
  SweepData(const RunStore& store, const std::string& metric);

  const std::vector<ArmData>& arms() const { return arms_; }
  const std::string& metric() const { return metric_; }

  /// The value of a grid's key in an arm, as a number; NaN if it is not a number, or not a key of
  /// the grid.
  double number(std::size_t arm, const std::string& key) const;
  /// The same as it was written; empty if it is no key of the grid.
  std::string text(std::size_t arm, const std::string& key) const;
  /// The arm where these keys have these values, within 1e-9; nullopt if there is none.
  std::optional<std::size_t> find(const std::vector<std::pair<std::string, double>>& values) const;
  /// The arms where a key has a value, in order.
  std::vector<std::size_t> where(const std::string& key, double value) const;
  /// The values of a key, ascending, each once.
  std::vector<double> values(const std::string& key) const;

 private:
  std::string metric_;
  std::vector<ArmData> arms_;
};

/// The numbers alone.
std::vector<double> values_of(const std::vector<SeededValue>& runs);

/// "εmean [low, high]": "2.31 [2.28, 2.35]"; the mean alone where there is no interval, and "-"
/// without runs.
std::string mean_text(const Summary& summary);
std::string interval_text(const Interval& interval);
/// "2/30 [0.82, 22.1] %".
std::string share_text(const Share& share);

}  // namespace tether
