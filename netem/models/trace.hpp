#pragma once

#include <istream>
#include <memory>
#include <string>
#include <vector>

#include "common/base/time.hpp"

namespace tether {

/// Recorded conditions of a channel.
///
/// CSV with a header line: time_s (strictly increasing, to the nanosecond), then delay_ms (>= 0)
/// and one of prr (0..1) and lost (0 or 1); at least one of the three. A row of PRR 0 may leave
/// delay_ms empty: its delay is interpolated in time between the nearest rows before and after that
/// have one, or is that of the only such neighbour. Without any delay all are 0. Other columns are
/// ignored. A packet log with a row for each packet that was sent is such a
/// trace, and so is a table of conditions by the second.
struct Trace {
  // Bounds that keep sums of times within the range of nanoseconds.
  static constexpr double kLongest_s = 1e9;
  static constexpr double kLongestDelay_ms = 1e9;

  struct Row {
    Duration since_first{0};
    Duration delay{0};
    double prr = 1.0;
  };
  std::vector<Row> rows;  ///< one or more; the first has since_first = 0
  double first_s = 0.0;   ///< time_s of the first row
  bool of_fates = false;  ///< prr comes from a column "lost", so is 0 or 1
};

/// Throws UsageError "name:line: …" for what is not such a file; `name` stands for it.
Trace read_trace(std::istream& in, const std::string& name);

/// The same from a file.
Trace load_trace(const std::string& file);
/// The same, read once while the file stays as it is.
std::shared_ptr<const Trace> kept_trace(const std::string& file);

}  // namespace tether
