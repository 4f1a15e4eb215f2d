#pragma once

#include <string>

namespace tether {

// What the commands that make something of a log have in common.

/// The log's name with another ending: run.lcmlog becomes run.mcap, and lcmlog-2026-01-01.00
/// lcmlog-2026-01-01.00.mcap.
std::string log_out_beside(const std::string& file, const std::string& extension);

/// Throws UsageError if the output would take the place of the log; an empty one is none.
void check_not_the_log(const std::string& file, const std::string& out);
/// Likewise, and that of a directory.
void check_log_out(const std::string& file, const std::string& out);

}  // namespace tether
