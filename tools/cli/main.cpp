#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <vector>

#include "common/program/cli.hpp"
#include "tools/base/process.hpp"
#include "tools/cli/commands.hpp"

namespace {

/// `tether X …` is `tether-X …` where a program of that name lies beside this one.
void become_sibling(int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  const std::string sibling =
      (tether::executable_folder() / ("tether-" + std::string(argv[1]))).string();
  std::vector<std::string> command(argv + 1, argv + argc);
  command.front() = sibling;
  if (access(sibling.c_str(), X_OK) == 0) execv(sibling.c_str(), tether::to_argv(command).data());
}

/// `tether netem fit …` and its like are this program's own, `tether netem SCENARIO …` the node.
bool is_own_subcommand(CLI::App& app, int argc, char** argv) {
  if (argc < 3) return false;
  for (CLI::App* command : app.get_subcommands({})) {
    if (!command->check_name(argv[1])) continue;
    const auto is_named = [&](const CLI::App* sub) { return sub->check_name(argv[2]); };
    return !command->get_subcommands(is_named).empty();
  }
  return false;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tether;
  CLI::App app("Tether: how much delay and loss does a remotely controlled AGV survive?", "tether");
  app.footer(
      "Also: tether sim, netem, controller, localiser, can-bridge and can-drive; the nodes of a "
      "live run.");
  add_about(app);
  app.require_subcommand(1);
  Action action;
  add_run_command(app, action);
  add_sweep_command(app, action);
  add_tune_command(app, action);
  add_merge_command(app, action);
  add_report_command(app, action);
  add_reproduce_command(app, action);
  add_live_command(app, action);
  add_view_command(app, action);
  add_spy_command(app, action);
  add_echo_command(app, action);
  add_log_command(app, action);
  add_can_command(app, action);
  add_netem_command(app, action);
  if (!is_own_subcommand(app, argc, argv)) become_sibling(argc, argv);
  const auto is_named = [&](const CLI::App* command) { return command->check_name(argv[1]); };
  if (argc > 1 && argv[1][0] != '-' && app.get_subcommands(is_named).empty()) {
    std::fprintf(stderr, "tether: error: there is no command \"%s\"; see tether --help\n", argv[1]);
    return kExitUsage;
  }
  return run_cli(app, argc, argv, [&action] { return action(); });
}
