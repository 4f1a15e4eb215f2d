#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <iostream>
#include <memory>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/fleet/fleet.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/run_settings.hpp"
#include "tools/base/scenario_options.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/commands.hpp"

namespace tether {
namespace {

struct PathOptions {
  ScenarioOptions scenario;
  std::size_t vehicle = 1;
  double period_s = 0.1;
  bool ask = false;
};

/// The shortest digits that are read back as the same numbers.
std::string row_of(const ReferencePath& path, double t_s) {
  const PathPoint p = path.at(t_s);
  return fmt::format("{},{},{},{},{},{}\n", t_s, p.x_m, p.y_m, p.yaw_rad, p.v_mps, p.omega_radps);
}

/// Answers times, a line each, until there are no more.
void answer(const ReferencePath& path, TextOutput& out) {
  for (std::string line; std::getline(std::cin, line);) {
    const auto t_s = to_number<double>(line);
    if (!t_s || !std::isfinite(*t_s)) {
      throw UsageError(fmt::format("path --ask: \"{}\" is no time in seconds",
                                   printable(line, kLongestNameShown)));
    }
    out.write(row_of(path, *t_s));
    out.flush();
  }
}

int tell_path(const PathOptions& options) {
  const Scenario scenario = options.scenario.load();
  const auto members = fleet_members(scenario);
  if (options.vehicle > members.size()) {
    throw UsageError(fmt::format("path: --vehicle must be 1 to {}", members.size()));
  }
  const auto path = make_path(members[options.vehicle - 1].get<PathSettings>());
  TextOutput out;
  out.write("t_s,x_m,y_m,yaw_rad,v_mps,omega_radps\n");
  if (options.ask) {
    out.flush();
    answer(*path, out);
  } else {
    const double duration_s = scenario.get<RunSettings>().duration_s;
    const auto rows = static_cast<std::int64_t>(std::floor(duration_s / options.period_s + 1e-9));
    for (std::int64_t i = 0; i <= rows; ++i) {
      out.write(row_of(*path, static_cast<double>(i) * options.period_s));
    }
  }
  out.close();
  return kExitOk;
}

}  // namespace

void add_path_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<PathOptions>();
  CLI::App* const command = tether.add_subcommand(
      "path", "Print position and speed along a scenario's path over time: CSV, exact to the bit");
  add_scenario(*command, options->scenario)->required();
  command->add_option("--vehicle", options->vehicle, "number of the vehicle in a fleet, from 1")
      ->check(CLI::Range(1, kMostVehicles))
      ->capture_default_str();
  CLI::Option* const period =
      command->add_option("--period", options->period_s, "interval between rows, s")
          ->check(number_between(1e-4, 3600.0))
          ->capture_default_str();
  command
      ->add_flag("--ask", options->ask,
                 "print a row for each time (one per line) on standard input")
      ->excludes(period);
  command->callback([options, &action] { action = [options] { return tell_path(*options); }; });
}

}  // namespace tether
