#pragma once

#include <CLI/CLI.hpp>

#include "tools/cli/commands.hpp"

namespace tether {

/// `tether log page`.
void add_log_page_command(CLI::App& log, Action& action);

}  // namespace tether
