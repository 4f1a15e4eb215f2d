#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "tools/cli/commands.hpp"

namespace tether {

/// `tether log csv FILE --out FOLDER`: all channels. Returns the exit code.
int log_csv_all(const std::string& file, const std::string& folder);

/// `tether log mcap`.
void add_log_mcap_command(CLI::App& log, Action& action);

}  // namespace tether
