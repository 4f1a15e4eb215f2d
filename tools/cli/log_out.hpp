#pragma once

#include <string>

namespace tether {

// Common parts of the commands that convert a log.

/// The log's name with another ending: run.lcmlog becomes run.mcap, and lcmlog-2026-01-01.00
/// lcmlog-2026-01-01.00.mcap.
std::string log_out_beside(const std::string& file, const std::string& extension);

/// Throws UsageError if the output would take the place of the log; an empty one is none.
void check_not_the_log(const std::string& file, const std::string& out);
/// The same for a directory.
void check_log_out(const std::string& file, const std::string& out);

}  // namespace tether
