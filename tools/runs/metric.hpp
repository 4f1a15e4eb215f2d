#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/time.hpp"

namespace tether {

/// One of metrics(), or an expression over them: "100 * uplink_lost / uplink_sent". The grammar is
/// muParser's: + - * / ^ ( ), numbers, min, max, abs, sqrt, exp, ln …; comparisons are 1 or 0, and
/// "c ? a : b" chooses.
class MetricExpression {
 public:
  /// Throws UsageError that says what is allowed and, of an expression, what is wrong with it.
  explicit MetricExpression(const std::string& text);
  MetricExpression(MetricExpression&&) noexcept;
  ~MetricExpression();

  /// Value for a run; `metrics` are in the order of metrics(). NaN where a metric of the expression
  /// is.
  double of(const std::vector<double>& metrics) const;

  /// It has an error in it (Metric::is_error).
  bool is_error() const { return is_error_; }
  /// It is a metric that is a share (Metric::is_share).
  bool is_share() const { return is_share_; }
  /// A metric's label, or the expression.
  const std::string& label() const { return label_; }

 private:
  struct Parsed;
  std::unique_ptr<Parsed> parsed_;
  bool is_error_ = false, is_share_ = false;
  std::string label_;
};

class RunObserver;

/// Metric of each run: in sweeps a column of their tables, one of the values of `metric`
/// and, but for the links' and `lost`, a number of the run's summary. A new one is a row in
/// metric.cpp; if it takes more than a line, its `of` has a file of its own.
struct Metric {
  /// A link's are with the link; `lost` is no number there.
  enum class InSummary { first, last, not_here };

  std::string name;   ///< an SQL column, with the unit
  std::string label;  ///< in figures and tables
  InSummary in_summary = InSummary::last;
  /// Value for a run that began at t = 0 and was over at `end`. Of newest reports: runs of sweeps
  /// have few.
  double (*of)(const RunObserver& run, Instant end) = nullptr;
  /// A distance to the reference: tables give it of the vehicles that were not lost.
  bool is_error = false;
  /// 0 or 1 for each run: the mean's interval is that of a share.
  bool is_share = false;
  /// Value for a fleet from the values of its vehicles.
  enum class OverFleet { mean, largest, sum } over_fleet = OverFleet::mean;
};

/// The metric of a run; `vehicles`: at least one.
double value_of(const Metric& metric, const std::vector<const RunObserver*>& vehicles, Instant end);

/// All metrics, in the order of columns.
const std::vector<Metric>& metrics();
std::vector<std::string> metric_names();

/// The place of a metric in metrics(); nullopt if the name is unknown.
std::optional<std::size_t> metric_number(std::string_view name);

}  // namespace tether
