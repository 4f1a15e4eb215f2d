#pragma once

#include <CLI/CLI.hpp>

#include "tools/base/action.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"

namespace tether {

// Each adds one subcommand of `tether`, with its options, and sets `action` when it is chosen.
// `tether` and `action` outlive the parsing and the action.
void add_run_command(CLI::App& tether, Action& action);
void add_sweep_command(CLI::App& tether, Action& action);
void add_tune_command(CLI::App& tether, Action& action);
void add_predict_command(CLI::App& tether, Action& action);
void add_merge_command(CLI::App& tether, Action& action);
void add_report_command(CLI::App& tether, Action& action);
void add_reproduce_command(CLI::App& tether, Action& action);
void add_live_command(CLI::App& tether, Action& action);
void add_log_command(CLI::App& tether, Action& action);
void add_spy_command(CLI::App& tether, Action& action);
void add_view_command(CLI::App& tether, Action& action);
void add_margin_command(CLI::App& tether, Action& action);
void add_path_command(CLI::App& tether, Action& action);

}  // namespace tether
