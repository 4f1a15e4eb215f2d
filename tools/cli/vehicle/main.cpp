#include <CLI/CLI.hpp>

#include "common/program/cli.hpp"
#include "tools/base/examples.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"

// On a vehicle's computer, where there is no `tether`.
int main(int argc, char** argv) {
  using namespace tether;
  CLI::App app("The commands of `tether` for a vehicle's computer: without any simulator",
               "tether-vehicle");
  add_about(app);
  app.require_subcommand(1);
  Action action;
  add_doctor_command(app, action);
  add_can_command(app, action);
  add_echo_command(app, action);
  add_record_command(app, action);
  add_metrics_command(app, action);
  add_lcm_route_command(app, action);
  add_can_links_command(app, action);
  add_command_examples(app);
  add_examples(app, {"tether-vehicle doctor --can can0", "tether-vehicle can status",
                     "tether-vehicle echo --quiet --duration 10"});
  return run_cli(app, argc, argv, [&action] { return action(); });
}
