#pragma once

#include <memory>
#include <string>
#include <vector>

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

}  // namespace tether
