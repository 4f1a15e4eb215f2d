#pragma once

#include <CLI/CLI.hpp>

#include "tools/base/action.hpp"

namespace tether {

// Subcommands that need no simulator, of `tether` and of `tether-vehicle`: as
// tools/cli/commands.hpp.
void add_can_command(CLI::App& tether, Action& action);
void add_can_links_command(CLI::App& tether, Action& action);
void add_doctor_command(CLI::App& tether, Action& action);
void add_echo_command(CLI::App& tether, Action& action);
void add_lcm_route_command(CLI::App& tether, Action& action);
void add_metrics_command(CLI::App& tether, Action& action);
void add_record_command(CLI::App& tether, Action& action);

}  // namespace tether
