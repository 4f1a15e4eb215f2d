#include "common/cli.hpp"
#include "tools/commands.hpp"

int main(int argc, char** argv) {
  using namespace tether;
  CLI::App app("Tether: how much delay and loss does a remotely controlled AGV survive?", "tether");
  add_version(app);
  app.require_subcommand(1);
  Action action;
  add_run_command(app, action);
  add_live_command(app, action);
  add_spy_command(app, action);
  add_echo_command(app, action);
  add_log_command(app, action);
  return run_cli(app, argc, argv, [&action] { return action(); });
}
