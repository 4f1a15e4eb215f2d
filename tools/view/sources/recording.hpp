#pragma once

#include <cstddef>
#include <limits>
#include <string>

#include "tools/log/log_survey.hpp"
#include "tools/view/sources/log_view.hpp"

namespace tether {

/// A log as the page plays it without a server (tools/view/page/model/embedded.js): a line of JSON,
///
///     {"title":…,"zero_us":…,"count":…,"channels":[{"id":…,"topic":…,"schemaName":…}…],"about":…}
///
/// then one line for each message, in order of time: "<microseconds> <channel> <JSON>". The JSON is
/// what the server sends, `about` what it says in /api/run.json.
struct Recording {
  /// Maximum size, which a browser unpacks into memory.
  static constexpr std::size_t kMostBytes = std::size_t{256} << 20;

  std::string text;
  std::size_t messages = 0;
  LeftOut left_out;
};

/// Which part of a log, in seconds as the page shows them.
struct RecordedSpan {
  double from_s = -std::numeric_limits<double>::infinity();
  double to_s = std::numeric_limits<double>::infinity();
};

/// Recording of that part of the log. Throws UsageError if that is nothing, or more than
/// `most_bytes`.
Recording record(ViewedLog& log, const RecordedSpan& span,
                 std::size_t most_bytes = Recording::kMostBytes);

}  // namespace tether
