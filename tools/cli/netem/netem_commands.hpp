#pragma once

#include <CLI/CLI.hpp>

#include "tools/base/action.hpp"

namespace tether {

/// `tether netem` and what it has below it.
void add_netem_command(CLI::App& tether, Action& action);
/// `tether netem check` and `tether netem export-tc`.
void add_netem_scenario_commands(CLI::App& netem, Action& action);
void add_netem_import_command(CLI::App& netem, Action& action);
void add_netem_plot_command(CLI::App& netem, Action& action);

}  // namespace tether
