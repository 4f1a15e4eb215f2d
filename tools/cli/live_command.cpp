#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/lcm/lcm_url.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/base/scenario_options.hpp"
#include "tools/cli/commands.hpp"
#include "tools/cli/view_command.hpp"
#include "tools/nodes/live_session.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

struct LiveOptions {
  LiveSession::Options session;
  ScenarioOptions scenario;
  std::optional<double> duration_s;
  bool json = false;
  bool view = false;
  ViewOptions viewing;
};

/// The session's own, and what nodes noticed that it does not hear, on another network.
std::vector<std::string> findings(const LiveSession& session) {
  std::vector<std::string> all = session.findings();
  for (const auto& [name, value] : session.observer().counters()) {
    if (!all.empty() || !name.ends_with(".senders.several") || value == 0) continue;
    all.push_back(fmt::format("several programs sent at the same time on one channel: {}", name));
  }
  for (const auto& vehicle : session.observer().vehicles()) {
    const auto& drives = vehicle->drivetrain();
    if (!drives || drives->ever_armed()) continue;
    all.push_back(fmt::format("the drives were never armed: {}: {}", drives->state().state_name,
                              drives->state().reason));
  }
  return all;
}

int live(LiveOptions options) {
  options.session.scenario_file = options.scenario.file;
  options.session.overrides = options.scenario.overrides();
  if (options.duration_s) {
    options.session.overrides.push_back(fmt::format("run.duration_s={}", *options.duration_s));
  }
  if (options.view) options.session.view = options.viewing.arguments();
  const Scenario scenario = load_scenario(options.session.scenario_file, options.session.overrides);
  for (const std::string& warning : scenario_warnings(scenario)) {
    fmt::print(stderr, "tether: {}: {}\n", options.scenario.file, warning);
  }
  LiveSession session(options.session, scenario);
  session.run();

  const FleetObserver& run = session.observer();
  const double end_s = to_seconds(session.end());
  const RunSummary summary{.wall_time_s = end_s / options.session.speed,
                           .sim_time_s = static_cast<double>(run.first().truth().utime) * 1e-6,
                           .end = session.end(),
                           .node_restarts = session.restarts(),
                           .findings = findings(session)};
  run.check_finite();
  const std::string json = to_json(scenario, run, summary);
  fmt::print("{}", options.json ? json + "\n" : to_text(scenario, run, summary));
  if (session.folder()) session.folder()->write(scenario, run, json);  // a full disk ends it here
  if (!options.json && session.folder()) {
    fmt::print("{:<9} {}\n", "picture", (session.folder()->path() / "path.png").string());
  }
  return summary.findings->empty() ? kExitOk : kExitFailed;
}

}  // namespace

void add_live_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<LiveOptions>();
  options->session.lcm_url = kDefaultLcmUrl;
  CLI::App* command = tether.add_subcommand(
      "live", "Run the loop as processes in real time over LCM; Ctrl-C ends it cleanly");
  add_scenario(*command, options->scenario)->required();
  add_seed(*command, options->scenario);
  command->add_option("--lcm-url", options->session.lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->add_option("--duration", options->duration_s, "override run.duration_s, seconds")
      ->check(number_between(0.001, 1e6));
  command
      ->add_option("--speed", options->session.speed,
                   "run seconds per wall second; below 1 is slow motion, for slow machines")
      ->check(number_between(0.01, 1.0))
      ->capture_default_str();
  command->add_option("--out", options->session.out,
                      "folder for the same results as `tether run` writes [none]");
  command->add_flag("--json", options->json, "print the summary as one JSON object");
  add_view_options(*command, options->viewing,
                   command->add_flag("--view", options->view, "show the run in the browser"));
  command->callback([options, &action] { action = [options] { return live(*options); }; });
}

}  // namespace tether
